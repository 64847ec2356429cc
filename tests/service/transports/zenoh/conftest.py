"""What the tests of zenoh share: a router, services that it knows, and a robot."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from typing import Any

import pytest
import zenoh

from service.application import Application
from service.settings import Settings
from service.transports.zenoh.replicas import REPLICAS
from service.transports.zenoh.server import serving
from tests.service.transports.zenoh.router import free_endpoint, routing, session
from tests.service.transports.zenoh.waiting import until

Served = Callable[..., Application]


@pytest.fixture(scope="session")
def endpoint() -> Iterator[str]:
    """Where a router listens."""
    endpoint = free_endpoint()
    with routing(endpoint):
        yield endpoint


@pytest.fixture
def robot(endpoint: str) -> Iterator[zenoh.Session]:
    """A node that is not the service."""
    with session(connect=endpoint) as robot:
        yield robot


@contextmanager
def running(application: Application) -> Iterator[None]:
    """Serves over zenoh from an event loop of its own; raises what keeps it from that."""
    loop, end, ready = asyncio.new_event_loop(), asyncio.Event(), threading.Event()

    async def serve() -> None:
        async with serving(application):
            ready.set()
            await end.wait()

    with ThreadPoolExecutor(1) as thread:
        served = thread.submit(loop.run_until_complete, serve())
        served.add_done_callback(lambda _: ready.set())
        ready.wait()
        try:
            if not served.done():
                yield
        finally:
            loop.call_soon_threadsafe(end.set)
            served.result()
            loop.close()


@pytest.fixture
def served(endpoint: str, robot: zenoh.Session, settings: Settings) -> Iterator[Served]:
    """Starts a replica with some settings of its own; it answers when this returns."""
    with ExitStack() as stack:

        def start(**more: Any) -> Application:
            given = settings.model_dump() | {"zenoh_connect": [endpoint]} | more
            application = Application(Settings(**given))
            stack.callback(application.close)
            before = len(replicas(robot))
            stack.enter_context(running(application))
            until(lambda: len(replicas(robot)) > before, "the replica is there")
            return application

        yield start


def replicas(robot: zenoh.Session) -> list[str]:
    """The replicas that a robot sees."""
    found = robot.liveliness().get(f"{REPLICAS}/*", timeout=2)
    return [str(reply.ok.key_expr) for reply in found if reply.ok]


def put(robot: zenoh.Session, key: str, payload: bytes, **more: Any) -> None:
    """Publishes, and waits for room on the connection: otherwise a busy machine drops clouds before they are sent."""
    robot.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK, **more)
