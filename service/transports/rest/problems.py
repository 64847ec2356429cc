"""Every error of the HTTP interface as a problem document (RFC 9457), and how OpenAPI describes them."""

from __future__ import annotations

import json
import logging
import time
from http import HTTPStatus
from typing import Any, NamedTuple
from urllib.parse import quote

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, Field
from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.routing import compile_path
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.engine.errors import Cancelled, InvalidParameter, ShapeConceptsError
from service.telemetry import current
from service.transports import errors
from service.transports.request_ids import name_request
from service.transports.rest import examples

log = logging.getLogger(__name__)

REQUEST_ID = "X-Request-ID"


class Refusal(NamedTuple):
    """How a status that the framework gives is told: its stable name, title and detail."""

    name: str
    title: str
    detail: str


REFUSALS = {
    400: Refusal("unreadable-body", "The body cannot be read", "{detail}"),
    404: Refusal(
        "not-found", "There is nothing here", "There is nothing at {path}; /openapi.json lists what there is."
    ),
    405: Refusal("method-not-allowed", "The method is not allowed", "{path} does not take {method}."),
    408: Refusal("request-timeout", "The request took too long to arrive", "{detail}"),
    413: Refusal("content-too-large", "The body is too large", "{detail}"),
    415: Refusal("unsupported-encoding", "The encoding of the body is not supported", "{detail}"),
}


class Problem(BaseModel):
    """What went wrong, after RFC 9457."""

    type: str = Field(
        description="stable name of the kind of error", examples=["urn:shape-concepts:error:too-few-points"]
    )
    title: str = Field(description="the kind of error in words", examples=["The cloud cannot be answered"])
    status: int = Field(description="HTTP status code", examples=[422])
    detail: str = Field(description="what was wrong this time, and what to try")
    instance: str = Field(description="names this occurrence: the request's id, as it is logged")


def documented(example: dict[str, Any], *statuses: int) -> dict[int | str, dict[str, Any]]:
    """OpenAPI's description of the answers of an operation, by HTTP status.

    Args:
        example: of the answer when all goes well.
        statuses: of the errors that may occur.
    """
    # As text: of a document the framework would leave out whatever is null.
    return {200: {"content": {"application/json": {"example": json.dumps(example)}}}} | refused(*statuses)


def refused(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """OpenAPI's description of errors, by HTTP status."""
    schema = {"$ref": "#/components/schemas/Problem"}
    described: dict[int | str, dict[str, Any]] = {}
    for status in statuses:
        content = {errors.MEDIA_TYPE: {"schema": schema, "example": examples.PROBLEMS[status]}}
        described[status] = {"description": HTTPStatus(status).phrase, "content": content}
    return described


def install(app: FastAPI) -> None:
    """Answers every error of an app with a problem document, names every request, and describes both."""
    describe = app.openapi

    def describe_with_problems() -> dict[str, Any]:
        description = describe()
        description["components"]["schemas"]["Problem"] = Problem.model_json_schema()
        _read_examples(description["paths"])
        return description

    app.openapi = describe_with_problems  # type: ignore[method-assign] # as FastAPI's documentation has it
    app.add_middleware(_Guard)
    app.add_exception_handler(ShapeConceptsError, _ours)
    app.add_exception_handler(HTTPException, _http)
    app.add_exception_handler(RequestValidationError, _validation)


def _read_examples(paths: dict[str, Any]) -> None:
    """Puts examples of answers that were given as text in its place."""
    for operations in paths.values():
        for operation in operations.values():
            for answer in operation["responses"].values():
                for media_type, content in answer.get("content", {}).items():
                    if media_type == "application/json" and isinstance(content.get("example"), str):
                        content["example"] = json.loads(content["example"])


class _Guard:
    """Gives each request an id, its own or a new one, logs it with that, and answers our own faults.

    The id brings the request, its answer, the log, and what the client and proxies on the way logged together.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return await self._app(scope, receive, send)
        request_id = name_request(Headers(scope=scope).get(REQUEST_ID, ""))
        scope.setdefault("state", {})["id"] = request_id
        status: int | None = None
        began = time.perf_counter()

        async def send_named(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                MutableHeaders(scope=message)[REQUEST_ID] = request_id
            await send(message)

        try:
            await self._app(scope, receive, send_named)
        except Exception as error:
            if status is not None:
                raise
            log.error("%s %s: unexpected", request_id, _quoted(scope["path"]), exc_info=error)
            detail = "The service failed unexpectedly; its log says more under the id of this request."
            document = errors.problem("internal", errors.INTERNAL.title, 500, detail, request_id)
            await _answer(document, {})(scope, receive, send_named)
        finally:
            took = (time.perf_counter() - began) * 1000
            log.debug("%s %s %s: %s in %.1f ms", request_id, scope["method"], _quoted(scope["path"]), status, took)


def _quoted(path: str) -> str:
    """A path as it was sent, percent-encoded: a line break in it begins no line of the log."""
    return quote(path, safe="/:@")


async def _ours(request: Request, error: Exception) -> Response:
    assert isinstance(error, ShapeConceptsError)
    status = errors.status_of(error)
    document = errors.problem_of(error, request.state.id)
    _note(error)
    if status.http >= 500:
        log.error("%s %s: %s: %s", request.state.id, _quoted(request.url.path), error.type_name(), error)
    elif isinstance(error, Cancelled):
        log.info("%s %s: %s", request.state.id, _quoted(request.url.path), error)
    headers = {"Retry-After": str(status.retry)} if status.retry else {}
    return _answer(document, headers | ({"WWW-Authenticate": "Bearer"} if status.http == 401 else {}))


async def _http(request: Request, error: Exception) -> Response:
    """What the framework refuses: a path that is not there, a method that is not allowed, a body too large."""
    assert isinstance(error, HTTPException)
    refusal = REFUSALS.get(
        error.status_code, Refusal(f"http-{error.status_code}", "The request was refused", "{detail}")
    )
    _note(refusal.name)
    detail = refusal.detail.format(path=request.url.path, method=request.method, detail=error.detail)
    document = errors.problem(refusal.name, refusal.title, error.status_code, detail, request.state.id)
    headers = dict(error.headers or {})
    if error.status_code == 405 and (methods := _methods(request)):
        headers = {"Allow": ", ".join(methods)}  # the framework tells those of one operation only
    return _answer(document, headers)


def _methods(request: Request) -> list[str]:
    """The methods that the path of a request takes."""
    paths: dict[str, dict[str, Any]] = request.app.openapi()["paths"]
    matching = [operations for path, operations in paths.items() if compile_path(path)[0].match(request.url.path)]
    return sorted({method.upper() for operations in matching for method in operations})


async def _validation(request: Request, error: Exception) -> Response:
    """A parameter of the wrong kind or out of its range, named."""
    assert isinstance(error, RequestValidationError)
    said = [f"{'.'.join(map(str, fault['loc'][1:]))}: {fault['msg']}" for fault in error.errors()]
    return await _ours(request, InvalidParameter("; ".join(said) + "."))


def _note(failure: ShapeConceptsError | str) -> None:
    """Tells the telemetry why the request fails: it sees no error that is answered."""
    if (seen := current()) is not None:
        seen.failed(failure)


def _answer(document: dict[str, Any], headers: dict[str, str]) -> JSONResponse:
    return JSONResponse(document, document["status"], headers, errors.MEDIA_TYPE)
