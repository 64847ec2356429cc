"""The calls of ShapeConceptsService: each converts, calls one use case, and converts back."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable
from contextlib import aclosing
from typing import Any

from service.application import Application
from service.engine.errors import InvalidParameter, ShapeConceptsError
from service.engine.model import OnStage
from service.transports.grpc import messages
from service.transports.grpc.flow import in_order
from service.transports.grpc.generated.shapeconcepts.v1 import (
    answer_pb2,
    cloud_pb2,
    scene_pb2,
    service_pb2,
    service_pb2_grpc,
)
from service.transports.grpc.guard import problem_of
from service.transports.grpc.share import Share
from service.transports.served import asking
from service.transports.wanted import run_while_wanted

AT_ONCE = 4  # clouds of one batch or stream at work, or answered and not yet sent


class Servicer(service_pb2_grpc.ShapeConceptsServiceServicer):
    """Answers for an application. Errors are raised as they are: the guard before it tells them to the client."""

    def __init__(self, application: Application) -> None:
        self._application = application

    async def Respond(  # noqa: N802 # as the service names it
        self, request: service_pb2.RespondRequest, context: Any
    ) -> service_pb2.RespondResponse:
        """Answers one cloud."""
        with self._application.intake.opened() as take:
            take(request.ByteSize())
            with self._application.pool.admitted():
                return service_pb2.RespondResponse(answer=await self._answer(request.cloud, request.options))

    async def RespondScene(  # noqa: N802
        self, request: service_pb2.RespondSceneRequest, context: Any
    ) -> service_pb2.RespondSceneResponse:
        """Answers each object of a scene."""
        with self._application.intake.opened() as take:
            take(request.ByteSize())
            with self._application.pool.admitted():
                answer = await self._answer_scene(request.cloud, request.options)
                return service_pb2.RespondSceneResponse(answer=answer)

    async def RespondBatch(  # noqa: N802
        self, request: service_pb2.RespondBatchRequest, context: Any
    ) -> AsyncIterator[service_pb2.RespondBatchResponse]:
        """Answers several clouds."""
        caller = asking.get()
        if len(request.clouds) > caller.max_batch:
            raise InvalidParameter(
                f"A batch has at most {caller.max_batch} clouds, not {len(request.clouds)}: send several."
            )
        share = Share(self._application.pool, kept=1)

        async def respond(index: int) -> service_pb2.RespondBatchResponse:
            async def answer() -> answer_pb2.Answer:
                async with share.place():
                    return await self._answer(request.clouds[index], request.options)

            return service_pb2.RespondBatchResponse(index=index, **await _outcome(answer()))

        with self._application.intake.opened() as take:
            take(request.ByteSize())
            with self._application.pool.admitted():
                caller.spend(len(request.clouds))
                async with aclosing(in_order(_count(len(request.clouds)), respond, AT_ONCE)) as responses:
                    async for response in responses:
                        yield response

    async def RespondStream(  # noqa: N802
        self, requests: AsyncIterator[service_pb2.RespondStreamRequest], context: Any
    ) -> AsyncIterator[service_pb2.RespondStreamResponse]:
        """Answers clouds as they come."""
        share = Share(self._application.pool)

        async def respond(request: service_pb2.RespondStreamRequest) -> service_pb2.RespondStreamResponse:
            async def answer() -> answer_pb2.Answer | scene_pb2.SceneAnswer:
                asking.get().spend(1)
                with self._application.intake.opened() as take:
                    take(request.ByteSize())
                    async with share.place():
                        if request.scene:
                            return await self._answer_scene(request.cloud, request.options)
                        return await self._answer(request.cloud, request.options)

            outcome = await _outcome(answer(), "scene_answer" if request.scene else "answer")
            return service_pb2.RespondStreamResponse(sequence=request.sequence, **outcome)

        async with aclosing(in_order(requests, respond, AT_ONCE)) as responses:
            async for response in responses:
                yield response

    async def ListModels(  # noqa: N802
        self, request: service_pb2.ListModelsRequest, context: Any
    ) -> service_pb2.ListModelsResponse:
        """Lists all models."""
        models = await asyncio.to_thread(self._application.models.all)
        return service_pb2.ListModelsResponse(models=map(messages.from_summary, models))

    async def GetModel(  # noqa: N802
        self, request: service_pb2.GetModelRequest, context: Any
    ) -> service_pb2.GetModelResponse:
        """Tells how a model was made."""

        def look_up() -> service_pb2.GetModelResponse:
            manifest = self._application.models.manifest(*self._application.which(**messages.to_reference(request)))
            return service_pb2.GetModelResponse(manifest=messages.from_manifest(manifest))

        return await asyncio.to_thread(look_up)

    async def ListConcepts(  # noqa: N802
        self, request: service_pb2.ListConceptsRequest, context: Any
    ) -> service_pb2.ListConceptsResponse:
        """Lists the concepts of a model."""

        def look_up() -> service_pb2.ListConceptsResponse:
            name, version = self._application.which(**messages.to_reference(request))
            concepts = self._application.models.concepts(name, version, messages.to_time(request))
            return service_pb2.ListConceptsResponse(list=messages.from_concepts(concepts))

        return await asyncio.to_thread(look_up)

    async def _answer(self, cloud: cloud_pb2.Cloud, options: answer_pb2.Options) -> answer_pb2.Answer:
        """The answer to a cloud, from the pool, which the caller has been admitted to.

        When nobody waits for it any more, the work ends with the stage that it is at.

        Raises:
            ShapeConceptsError: whatever the application raises.
        """

        def work(on_stage: OnStage) -> answer_pb2.Answer:
            given = messages.to_options(options)
            given["max_points"] = asking.get().max_points
            return messages.from_answer(self._application.respond(messages.to_cloud(cloud), **given, on_stage=on_stage))

        return await run_while_wanted(self._application.pool, work)

    async def _answer_scene(self, cloud: cloud_pb2.Cloud, options: answer_pb2.Options) -> scene_pb2.SceneAnswer:
        """The answer to each object of a scene, as `_answer` gives that to one cloud."""

        def work(on_stage: OnStage) -> scene_pb2.SceneAnswer:
            given = messages.to_options(options)
            given["max_points"] = asking.get().max_points
            answer = self._application.respond_scene(messages.to_cloud(cloud), **given, on_stage=on_stage)
            return messages.from_scene(answer)

        return await run_while_wanted(self._application.pool, work)


async def _outcome(
    answering: Awaitable[answer_pb2.Answer | scene_pb2.SceneAnswer], field: str = "answer"
) -> dict[str, Any]:
    """What became of one cloud of several, as fields of the response: the answer, or the problem."""
    try:
        return {field: await answering}
    except ShapeConceptsError as error:
        return {"problem": problem_of(error)}


async def _count(number: int) -> AsyncIterator[int]:
    for index in range(number):
        yield index
