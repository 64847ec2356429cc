"""The gRPC server: our service, health and reflection on one port of the event loop that all transports share."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager

import grpc
from grpc_health.v1 import health_pb2, health_pb2_grpc
from grpc_health.v1.health import SERVICE_NAME as HEALTH
from grpc_health.v1.health import aio as health
from grpc_reflection.v1alpha import reflection, reflection_pb2_grpc

from service.application import Application
from service.engine.errors import ShapeConceptsError
from service.settings import Settings
from service.transports.grpc.generated.shapeconcepts.v1 import jobs_pb2_grpc, service_pb2_grpc
from service.transports.grpc.guard import SERVICE, Guard
from service.transports.grpc.jobs import SCOPES, JobsServicer
from service.transports.grpc.jobs import SERVICE as JOBS
from service.transports.grpc.servicer import Servicer
from service.transports.served import Served

log = logging.getLogger(__name__)

CALLS = 256  # open at a time; streams are silent for most of theirs
ANSWERING = ("Respond", "RespondScene", "RespondBatch")  # calls that need a place in the pool as soon as they begin
OTHERS = 64  # calls beside those: to health and reflection
READY_EVERY = 1.0  # seconds after which it is asked again whether there is a model to answer with
CLOSING = 1.0  # seconds in which the last words are sent; calls that watch our health would go on for ever
KEEPALIVE = 30_000  # milliseconds of silence after which a client is asked whether it is there still
KEEPALIVE_LEAST = 5_000  # milliseconds: clients may ask as often


@asynccontextmanager
async def serving(application: Application, grace: float, beside: Sequence[Served] = ()) -> AsyncIterator[int | None]:
    """Answers on the port of the settings for as long as the context is open; then finishes what was accepted.

    Args:
        application: what answers.
        grace: how long what was accepted may take at the end, seconds.
        beside: services of other transports that are answered here as well.

    Yields:
        The port; None where the settings want no gRPC.

    Raises:
        SystemExit: the port cannot be listened on; the reason is logged.
    """
    settings = application.settings
    if settings.grpc_port < 0:
        yield None
        return
    names = (SERVICE, JOBS, *(service.name for service in beside))
    unlocked = frozenset(f"/{service.name}/{call}" for service in beside for call in service.open)
    answering = frozenset(f"/{SERVICE}/{call}" for call in ANSWERING)
    guard = Guard(
        application.access,
        application.telemetry,
        CALLS,
        settings.body_timeout,
        names,
        unlocked,
        SCOPES,
        application.pool.check,
        answering,
    )
    service_pb2_grpc.add_ShapeConceptsServiceServicer_to_server(Servicer(application), guard)
    jobs_pb2_grpc.add_JobsServiceServicer_to_server(JobsServicer(application.training), guard)
    for service in beside:
        service.add(guard)
    states = health.HealthServicer()
    health_pb2_grpc.add_HealthServicer_to_server(states, guard)
    learnt = reflection.aio.ReflectionServicer((*names, HEALTH, reflection.SERVICE_NAME))
    reflection_pb2_grpc.add_ServerReflectionServicer_to_server(learnt, guard)
    server = grpc.aio.server(
        handlers=[guard], options=_options(settings.max_body), maximum_concurrent_rpcs=CALLS + OTHERS
    )
    port = _listen(server, settings)
    watching = asyncio.create_task(_watch(application, states, ("", *names)))
    await server.start()
    log.info("gRPC on %s:%d%s", settings.host, port, " with TLS" if settings.tls_certificate else "")
    try:
        yield port
    finally:
        watching.cancel()
        await states.enter_graceful_shutdown()
        stopping = asyncio.create_task(server.stop(grace))
        await guard.end(grace)
        await server.stop(CLOSING)
        await stopping


def _options(max_body: int) -> list[tuple[str, int]]:
    return [
        ("grpc.max_receive_message_length", max_body),
        ("grpc.max_send_message_length", -1),
        ("grpc.so_reuseport", 0),  # or a second process would share the port, and each get half the calls
        ("grpc.compression_enabled_algorithms_bitset", 1),  # none: a message is only measured when it is unpacked
        ("grpc.http2.bdp_probe", 0),  # or up to megabytes of small clouds are let in that nobody works on yet
        ("grpc.keepalive_time_ms", KEEPALIVE),
        ("grpc.http2.min_ping_interval_without_data_ms", KEEPALIVE_LEAST),
    ]


def _listen(server: grpc.aio.Server, settings: Settings) -> int:
    host = f"[{settings.host}]" if ":" in settings.host else settings.host
    address = f"{host}:{settings.grpc_port}"
    try:
        if settings.tls_certificate and settings.tls_key:
            files = (settings.tls_key.read_bytes(), settings.tls_certificate.read_bytes())
            return int(server.add_secure_port(address, grpc.ssl_server_credentials([files])))
        return int(server.add_insecure_port(address))
    except (RuntimeError, OSError) as error:
        log.error("gRPC cannot listen on %s: %s. Give another port with --grpc-port; -1 for no gRPC.", address, error)
        raise SystemExit(1) from None


async def _watch(application: Application, states: health.HealthServicer, names: Sequence[str]) -> None:
    """Says SERVING while there is a model to answer with: asked here, so that who asks for our health never waits."""
    await _say(states, names, health_pb2.HealthCheckResponse.NOT_SERVING)
    while True:
        try:
            await asyncio.to_thread(application.ready)
            await _say(states, names, health_pb2.HealthCheckResponse.SERVING)
        except ShapeConceptsError:
            await _say(states, names, health_pb2.HealthCheckResponse.NOT_SERVING)
        except Exception:
            log.exception("whether there is a model cannot be told")
            await _say(states, names, health_pb2.HealthCheckResponse.NOT_SERVING)
        await asyncio.sleep(READY_EVERY)


async def _say(states: health.HealthServicer, names: Sequence[str], status: int) -> None:
    for service in names:
        await states.set(service, status)
