"""GET /healthz and /readyz: for whoever starts, stops and balances the service."""

from __future__ import annotations

from typing import Literal

from fastapi import APIRouter, Request, Response
from fastapi.responses import JSONResponse
from pydantic import BaseModel, Field

from service.application import Application, Readiness
from service.engine.errors import ShapeConceptsError
from service.transports import errors
from service.transports.rest import examples
from service.transports.rest.problems import documented


class Health(BaseModel):
    """That the process lives."""

    status: Literal["ok"] = Field("ok", description="always ok: otherwise there is no answer")


def router(application: Application) -> APIRouter:
    """The operations, for an application."""
    routes = APIRouter(tags=["health"])

    @routes.get(
        "/healthz",
        summary="Does the process live?",
        responses=documented({"status": "ok"}),
    )
    async def healthz() -> Health:
        """Answers whenever the process does, whatever the store and the load."""
        return Health()

    @routes.get(
        "/readyz",
        summary="Can it answer clouds, and with which model?",
        responses=documented(examples.READINESS, 503),
        response_model=Readiness,
    )
    def readyz(request: Request) -> Readiness | Response:
        """503 while there is no model, or the default model cannot be used, or the store was never within reach."""
        try:
            return application.ready()
        except ShapeConceptsError as error:
            document = errors.problem_of(error, request.state.id) | {"status": 503}
            return JSONResponse(document, 503, {"Retry-After": str(errors.RETRY_AFTER)}, errors.MEDIA_TYPE)

    return routes
