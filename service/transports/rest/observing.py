"""Every HTTP request as it is seen from outside, and GET /metrics."""

from __future__ import annotations

from fastapi import APIRouter, Request, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.application import Application
from service.telemetry import OTHER, Wire

TRACE = (b"traceparent", b"tracestate")
OPEN_INFERENCE = "/v2"  # below it the Open Inference Protocol is spoken


class Observing:
    """Measures each request of an app; stands inside of what gives requests their ids."""

    def __init__(self, app: ASGIApp, application: Application) -> None:
        self._app = app
        self._telemetry = application.telemetry

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Hands the request on."""
        if scope["type"] != "http":
            return await self._app(scope, receive, send)
        path = scope["path"]
        wire: Wire = "open-inference" if path == OPEN_INFERENCE or path.startswith(f"{OPEN_INFERENCE}/") else "rest"
        carrier = {name.decode(): value.decode("latin-1") for name, value in scope["headers"] if name in TRACE}
        with self._telemetry.request(wire, scope["state"]["id"], carrier=carrier) as seen:

            async def send_seen(message: Message) -> None:
                if message["type"] == "http.response.start" and message["status"] >= 400:
                    seen.failed(f"http-{message['status']}")  # unless its name is known already
                await send(message)

            try:
                await self._app(scope, receive, send_seen)
            finally:
                seen.operation = _operation(scope)


def router(application: Application) -> APIRouter:
    """GET /metrics, for an application."""
    routes = APIRouter()

    @routes.get("/metrics", include_in_schema=False)
    def metrics(request: Request) -> Response:
        content, media_type = application.telemetry.metrics.page(request.headers.get("accept", ""))
        return Response(content, headers={"Content-Type": media_type})

    return routes


def _operation(scope: Scope) -> str:
    """Method and template of the route that a request was for: as they are written here, not as a client wrote them."""
    route = scope.get("route")
    template, methods = getattr(route, "path", None), getattr(route, "methods", None) or ()
    return f"{scope['method']} {template}" if template and scope["method"] in methods else OTHER
