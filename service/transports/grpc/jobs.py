"""The calls of JobsService: each converts, calls one use case, and converts back."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from typing import Any

from service.engine.errors import InvalidParameter, JobsUnavailable
from service.scopes import Scope
from service.training import Training
from service.transports.following import follow
from service.transports.grpc import job_messages as messages
from service.transports.grpc.generated.shapeconcepts.v1 import jobs_pb2, jobs_pb2_grpc

SERVICE = jobs_pb2.DESCRIPTOR.services_by_name["JobsService"].full_name
ALTERING = ("Submit", "Cancel", "Retry")
SCOPES: dict[str, tuple[Scope, ...]] = {
    f"/{SERVICE}/{method.name}": ("train",) if method.name in ALTERING else ("answer", "train")
    for method in jobs_pb2.DESCRIPTOR.services_by_name["JobsService"].methods
}
PAGE, LARGEST_PAGE = 20, 100  # jobs


class JobsServicer(jobs_pb2_grpc.JobsServiceServicer):
    """Answers for the use cases on jobs. Errors are raised as they are: the guard tells them to the client."""

    def __init__(self, training: Training) -> None:
        self._training = training

    async def Submit(  # noqa: N802 # as the service names it
        self, request: jobs_pb2.SubmitRequest, context: Any
    ) -> jobs_pb2.SubmitResponse:
        """Puts a job into the queue."""
        spec = messages.to_spec(request.spec)
        job = await asyncio.to_thread(self._training.submit, spec, request.id or None)
        return jobs_pb2.SubmitResponse(job=messages.from_job(job))

    async def Get(self, request: jobs_pb2.GetRequest, context: Any) -> jobs_pb2.GetResponse:  # noqa: N802
        """Tells how a job stands."""
        return jobs_pb2.GetResponse(job=messages.from_job(await asyncio.to_thread(self._training.job, request.id)))

    async def List(self, request: jobs_pb2.ListRequest, context: Any) -> jobs_pb2.ListResponse:  # noqa: N802
        """Lists jobs."""
        if request.page_size > LARGEST_PAGE:
            raise InvalidParameter(f"A page has at most {LARGEST_PAGE} jobs, not {request.page_size}.")
        page = await asyncio.to_thread(
            self._training.jobs,
            request.page_size or PAGE,
            request.page_token or None,
            messages.to_state(request.state),
        )
        return jobs_pb2.ListResponse(jobs=map(messages.from_job, page.jobs), next_page_token=page.next or "")

    async def Cancel(self, request: jobs_pb2.CancelRequest, context: Any) -> jobs_pb2.CancelResponse:  # noqa: N802
        """Takes a job from the queue, or stops it."""
        job = await asyncio.to_thread(self._training.cancel, request.id)
        return jobs_pb2.CancelResponse(job=messages.from_job(job))

    async def Retry(self, request: jobs_pb2.RetryRequest, context: Any) -> jobs_pb2.RetryResponse:  # noqa: N802
        """Lets a job go on."""
        job = await asyncio.to_thread(self._training.retry, request.id)
        return jobs_pb2.RetryResponse(job=messages.from_job(job))

    async def Watch(  # noqa: N802
        self, request: jobs_pb2.WatchRequest, context: Any
    ) -> AsyncIterator[jobs_pb2.WatchResponse]:
        """Follows a job."""
        await asyncio.to_thread(self._training.job, request.id)
        over = False
        with self._training.following():
            async for look in follow(self._training, request.id, request.after):
                if look is not None:
                    yield messages.from_look(look)
                    over = look.job.over
        if not over:
            raise JobsUnavailable("The service is ending; follow the job at another one, or in a moment.")
