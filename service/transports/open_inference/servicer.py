"""The calls of the protocol over gRPC; each converts, calls one use case, and converts back."""

from __future__ import annotations

import asyncio
from typing import Any

from service.application import Application
from service.engine.errors import ModelDamaged, ModelIncompatible, ModelNotFound, ShapeConceptsError
from service.engine.model import OnStage
from service.transports.open_inference.generated.inference import grpc_service_pb2 as pb
from service.transports.open_inference.generated.inference import grpc_service_pb2_grpc as pb_grpc
from service.transports.open_inference.grpc_messages import read_request, write_response
from service.transports.open_inference.inference import infer, metadata, parse_model, parse_version
from service.transports.open_inference.signature import SERVER
from service.transports.served import Served, asking
from service.transports.wanted import run_while_wanted

SERVICE: str = pb.DESCRIPTOR.services_by_name["GRPCInferenceService"].full_name
HEALTH = frozenset({"ServerLive", "ServerReady"})


def served(application: Application) -> Served:
    """The protocol's service, for an application."""
    return Served(
        SERVICE,
        lambda server: pb_grpc.add_GRPCInferenceServiceServicer_to_server(Servicer(application), server),
        open=HEALTH,
    )


class Servicer(pb_grpc.GRPCInferenceServiceServicer):
    """Answers for an application. Errors are raised as they are: the server tells them to the client."""

    def __init__(self, application: Application) -> None:
        self._application = application

    async def ServerLive(  # noqa: N802 # as the protocol names it
        self, request: pb.ServerLiveRequest, context: Any
    ) -> pb.ServerLiveResponse:
        """Says that the process lives."""
        return pb.ServerLiveResponse(live=True)

    async def ServerReady(  # noqa: N802
        self, request: pb.ServerReadyRequest, context: Any
    ) -> pb.ServerReadyResponse:
        """Says whether there is a model to answer with."""
        try:
            await asyncio.to_thread(self._application.ready)
        except ShapeConceptsError:
            return pb.ServerReadyResponse(ready=False)
        return pb.ServerReadyResponse(ready=True)

    async def ModelReady(  # noqa: N802
        self, request: pb.ModelReadyRequest, context: Any
    ) -> pb.ModelReadyResponse:
        """Says whether a model can answer."""
        model, version = parse_model(request.name), parse_version(request.version)
        try:
            await asyncio.to_thread(self._application.prepare, model, version)
        except (ModelNotFound, ModelDamaged, ModelIncompatible):
            return pb.ModelReadyResponse(ready=False)
        return pb.ModelReadyResponse(ready=True)

    async def ServerMetadata(  # noqa: N802
        self, request: pb.ServerMetadataRequest, context: Any
    ) -> pb.ServerMetadataResponse:
        """Says what the service is."""
        return pb.ServerMetadataResponse(**SERVER)

    async def ModelMetadata(  # noqa: N802
        self, request: pb.ModelMetadataRequest, context: Any
    ) -> pb.ModelMetadataResponse:
        """Says what a model takes and gives."""
        said = await asyncio.to_thread(metadata, self._application, request.name, request.version)
        return pb.ModelMetadataResponse(**said)

    async def ModelInfer(  # noqa: N802
        self, request: pb.ModelInferRequest, context: Any
    ) -> pb.ModelInferResponse:
        """Answers a cloud."""

        def work(on_stage: OnStage) -> pb.ModelInferResponse:
            asked = read_request(request, asking.get().max_points)
            return write_response(infer(self._application, asked, on_stage), asked.id)

        with self._application.intake.opened() as take:
            take(request.ByteSize())
            with self._application.pool.admitted():
                return await run_while_wanted(self._application.pool, work)
