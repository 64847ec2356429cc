"""The protocol over HTTP, below /v2, as an ASGI app; its errors are {"error": "..."}."""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack
from functools import partial

from fastapi.concurrency import run_in_threadpool
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from service.access import Caller
from service.application import Application
from service.engine.errors import Cancelled, ShapeConceptsError
from service.engine.model import OnStage
from service.scopes import Scope
from service.telemetry import current
from service.transports import errors
from service.transports.arriving import arriving, limits_of, whole
from service.transports.connected import while_connected
from service.transports.entering import entered, key_in
from service.transports.open_inference.inference import infer, metadata, parse_model, parse_version
from service.transports.open_inference.rest_messages import HEADER_LENGTH, Body, read_request, write_response
from service.transports.open_inference.signature import SERVER
from service.transports.wanted import run_while_wanted

log = logging.getLogger(__name__)

PATHS = "/v2{rest:path}"  # all that the app answers; it sees the paths whole
MODEL = "/v2/models/{model}"
VERSION = MODEL + "/versions/{version}"

Endpoint = Callable[[Request], Awaitable[Response]]


def create_app(application: Application) -> Starlette:
    """An app that answers for an application, below /v2."""
    endpoints = _Endpoints(application)

    def route(path: str, endpoint: Endpoint, scope: Scope | None = "answer", method: str = "GET") -> Route:
        return Route(path, _told(application, scope, endpoint), methods=[method])

    return Starlette(
        routes=[
            route("/v2", endpoints.server),
            route("/v2/health/live", endpoints.live, None),
            route("/v2/health/ready", endpoints.ready, None),
            *(
                route(path + end, endpoint, method=method)
                for path in (MODEL, VERSION)
                for end, endpoint, method in (
                    ("", endpoints.model, "GET"),
                    ("/ready", endpoints.model_ready, "GET"),
                    ("/infer", endpoints.infer, "POST"),
                )
            ),
        ],
        exception_handlers={HTTPException: _refused},
    )


class _Endpoints:
    """The calls of the protocol; each converts, calls one use case, and converts back."""

    def __init__(self, application: Application) -> None:
        self._application = application

    async def server(self, request: Request) -> Response:
        return JSONResponse(SERVER)

    async def live(self, request: Request) -> Response:
        return JSONResponse({"live": True})

    async def ready(self, request: Request) -> Response:
        try:
            await run_in_threadpool(self._application.ready)
        except ShapeConceptsError as error:
            return _answer(503, _detail(error), {"Retry-After": str(errors.RETRY_AFTER)})
        return JSONResponse({"ready": True})

    async def model(self, request: Request) -> Response:
        model, version = _meant(request)
        return JSONResponse(await run_in_threadpool(metadata, self._application, model, version))

    async def model_ready(self, request: Request) -> Response:
        model, version = _meant(request)
        name, _ = await run_in_threadpool(self._application.prepare, parse_model(model), parse_version(version))
        return JSONResponse({"name": name, "ready": True})

    async def infer(self, request: Request) -> Response:
        caller: Caller = request.state.caller
        with self._application.intake.opened() as take:
            async with arriving(request, limits_of(self._application.settings, caller), take) as limited:
                body = await whole(limited)
            with self._application.pool.admitted():
                work = partial(
                    self._infer, body, request.headers.get(HEADER_LENGTH), *_meant(request), caller.max_points
                )
                wanted = run_while_wanted(self._application.pool, work)
                content, length = await while_connected(request, wanted)
        if length is None:
            return Response(content, media_type="application/json")
        return Response(content, headers={HEADER_LENGTH: str(length)}, media_type="application/octet-stream")

    def _infer(
        self, body: bytes, json_length: str | None, model: str, version: str, max_points: int, on_stage: OnStage
    ) -> Body:
        asked = read_request(body, json_length, model, version, max_points)
        return write_response(infer(self._application, asked.inference, on_stage), asked.inference.id, asked.binary)


def _told(application: Application, scope: Scope | None, endpoint: Endpoint) -> Endpoint:
    """An endpoint for those whose access keys allow it (None: for everybody); its errors are the protocol's."""

    async def told(request: Request) -> Response:
        try:
            async with AsyncExitStack() as stack:
                if scope is not None:
                    key = key_in(request.headers.get("authorization", ""))
                    request.state.caller = await stack.enter_async_context(entered(application.access, key, scope))
                return await endpoint(request)
        except ShapeConceptsError as error:
            return _ours(request, error)
        except HTTPException:
            raise
        except Exception as error:
            log.error("%s %s: unexpected", _request_id(request), request.url.path, exc_info=error)
            return _answer(500, "The service failed unexpectedly; its log says more.", {})

    return told


def _ours(request: Request, error: ShapeConceptsError) -> Response:
    status = errors.status_of(error)
    if (seen := current()) is not None:
        seen.failed(error)  # the telemetry sees no error that is answered
    if status.http >= 500:
        log.error("%s %s: %s: %s", _request_id(request), request.url.path, error.type_name(), error)
    elif isinstance(error, Cancelled):
        log.info("%s %s: %s", _request_id(request), request.url.path, error)
    headers = {"Retry-After": str(status.retry)} if status.retry else {}
    return _answer(
        status.http, _detail(error), headers | ({"WWW-Authenticate": "Bearer"} if status.http == 401 else {})
    )


async def _refused(request: Request, error: Exception) -> Response:
    """What is refused before any use case: a path that is not there, a method that is not allowed, a body too large."""
    assert isinstance(error, HTTPException)
    known = {
        404: f"There is nothing at {request.url.path}.",
        405: f"{request.url.path} does not take {request.method}.",
    }
    return _answer(error.status_code, known.get(error.status_code, error.detail), dict(error.headers or {}))


def _answer(status: int, detail: str, headers: dict[str, str]) -> Response:
    return JSONResponse({"error": detail}, status, headers)


def _detail(error: ShapeConceptsError) -> str:
    return str(errors.problem_of(error, "")["detail"])


def _meant(request: Request) -> tuple[str, str]:
    """The model and the version that the path names; "" for no version."""
    return request.path_params["model"], request.path_params.get("version", "")


def _request_id(request: Request) -> str:
    return str(getattr(request.state, "id", "-"))
