"""Starts the service, and ends it cleanly."""

from __future__ import annotations

import asyncio
import logging
import signal
import sys
import threading
from contextlib import AsyncExitStack
from types import FrameType
from typing import Any

import uvicorn
from fastapi import FastAPI
from starlette.routing import Route

from service import logs, traces
from service.access import check_keys, check_tls, needs_keys
from service.application import Application, CloudFile
from service.engine.errors import ShapeConceptsError
from service.settings import Settings
from service.telemetry import Telemetry
from service.transports.grpc.server import serving as serving_grpc
from service.transports.http1 import Protocol
from service.transports.open_inference import rest as open_inference
from service.transports.open_inference.description import describe_in
from service.transports.open_inference.servicer import served as open_inference_served
from service.transports.rest.access import without_need_of_keys
from service.transports.rest.app import create_app
from service.transports.rest.examples import CLOUD_XYZ
from service.transports.zenoh.server import serving as serving_zenoh

log = logging.getLogger(__name__)

SWITCH = (
    0.001  # seconds that a thread at work keeps the interpreter from the event loop, which does so little each time
)
IDLE = 75  # seconds that a connection may idle: longer than clients keep one, who so never use one that is being closed
GRACE = 30  # seconds that requests under way have when the service is told to end


def serve(settings: Settings) -> None:
    """Serves until SIGTERM or SIGINT; then finishes the requests under way and returns.

    Raises:
        StoreUnavailable: the URL of the store is of no known kind, or where keys are needed, they cannot be read.
        InvalidParameter: keys are needed and there are none, or a file for TLS is missing.
        SystemExit: an address cannot be listened on.
    """
    sys.setswitchinterval(SWITCH)
    logs.set_up(settings.log_level, settings.log_format)
    check_tls(settings)
    application = Application(settings, Telemetry(traces.from_environment()))
    if needs_keys(settings):
        check_keys(settings, application.valid_keys())
    threading.Thread(target=_warm, args=[application], name="warm", daemon=True).start()
    for number in (signal.SIGTERM, signal.SIGINT):
        # The HTTP server raises them again once it has ended; that is an ordinary end, exit code 0.
        signal.signal(number, lambda *_: None)
    try:
        asyncio.run(_serve(application, settings))
    except SystemExit:  # the reason is logged
        raise SystemExit(1) from None


def http_app(application: Application) -> FastAPI:
    """All that is answered over HTTP; what one transport does around its answers is done around the other's."""
    app = create_app(application)
    app.router.routes.append(Route(open_inference.PATHS, open_inference.create_app(application)))
    describe = app.openapi

    def described() -> dict[str, Any]:
        document = describe_in(describe())
        return without_need_of_keys(document) if application.access.open else document

    app.openapi = described  # type: ignore[method-assign] # as FastAPI's documentation has it
    return app


class _Server(uvicorn.Server):
    """An HTTP server that lets those who follow jobs or watch streams go when it is told to end: they would stay."""

    def __init__(self, config: uvicorn.Config, application: Application) -> None:
        super().__init__(config)
        self._application = application

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Called with the signal that tells it to end."""
        self._application.let_go()
        super().handle_exit(sig, frame)


async def _serve(application: Application, settings: Settings) -> None:
    """Opens every transport, the HTTP server last: it is the one that waits for the signals."""
    server = _Server(
        uvicorn.Config(
            http_app(application),
            http=Protocol,
            host=settings.host,
            port=settings.port,
            log_config=None,
            access_log=False,  # telemetry writes a line a request, for every transport
            ssl_certfile=settings.tls_certificate,
            ssl_keyfile=settings.tls_key,
            timeout_keep_alive=IDLE,
            timeout_graceful_shutdown=GRACE,
        ),
        application,
    )
    async with AsyncExitStack() as stack:
        stack.callback(application.close)
        await stack.enter_async_context(serving_grpc(application, GRACE, [open_inference_served(application)]))
        await stack.enter_async_context(serving_zenoh(application))
        await server.serve()


def _warm(application: Application) -> None:
    """Loads the default model and answers a cloud, so that the first request need not wait for the compiler."""
    try:
        ready = application.ready()
        if ready.model is None:
            log.info("serving the models %s of %s", ", ".join(ready.models), application.store.url)
        else:
            place = f"built in, as {application.store.url} holds no model" if ready.built_in else application.store.url
            log.info("serving %s:%s (%s)", ready.model, ready.version, place)
            application.respond(CloudFile(CLOUD_XYZ.encode(), "xyz"), model=ready.model, version=ready.version)
    except ShapeConceptsError as error:
        log.warning("not ready: %s", error)


if __name__ == "__main__":
    serve(Settings())
