"""gRPC servers that answer on the loopback address for the length of a test, and a client of one."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from typing import Any

import grpc
import pytest

from service.answer import Answer
from service.application import Application, CloudFile
from service.scene_answer import SceneAnswer
from service.settings import Settings
from service.transports.grpc.generated.shapeconcepts.v1.service_pb2_grpc import ShapeConceptsServiceStub
from service.transports.grpc.server import serving
from service.transports.served import Served

HELD = "held"  # name of the clouds whose answers wait until they are let go


class Held(Application):
    """An application that begins on some clouds and goes on with them when it is told to."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings)
        self.go = threading.Event()
        self.held = threading.Semaphore(0)  # how many were begun
        self.stopped = threading.Semaphore(0)  # how many were broken off

    def respond(self, cloud: Any, **given: Any) -> Answer:
        self._hold(cloud, given)
        return super().respond(cloud, **given)

    def respond_scene(self, scene: Any, **given: Any) -> SceneAnswer:
        self._hold(scene, given)
        return super().respond_scene(scene, **given)

    def _hold(self, cloud: Any, given: dict[str, Any]) -> None:
        if isinstance(cloud, CloudFile) and cloud.name == HELD:
            self.held.release()
            try:
                while not self.go.wait(0.01):
                    given["on_stage"]("waiting")
            except Exception:
                self.stopped.release()
                raise


class Server:
    """A server on an event loop and a thread of its own; `error` is what it ended with."""

    def __init__(self, application: Application, grace: float = 30, beside: Sequence[Served] = ()) -> None:
        self._application, self._grace, self._beside = application, grace, beside
        self._told = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self.error: BaseException | None = None
        self.address = ""

    def start(self) -> None:
        self._thread.start()
        assert self._told.wait(30)

    def tell_to_end(self) -> None:
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._end.set)

    def wait_for_the_end(self) -> None:
        self._thread.join(60)
        assert not self._thread.is_alive()

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        except BaseException as error:
            self.error = error
        finally:
            self._told.set()

    async def _serve(self) -> None:
        self._loop, self._end = asyncio.get_running_loop(), asyncio.Event()
        async with serving(self._application, self._grace, self._beside) as port:
            self.address = f"127.0.0.1:{port}"
            self._told.set()
            await self._end.wait()


@pytest.fixture
def settings(settings: Settings) -> Settings:
    return settings.model_copy(update={"grpc_port": 0})


@pytest.fixture
def start(application: Application) -> Iterator[Callable[..., Server]]:
    """Starts servers, of the test's application unless another is given; in the end they are told to end."""
    with ExitStack() as stack:

        def start(of: Application = application, **given: Any) -> Server:
            server = Server(of, **given)
            server.start()
            if server.error is None:
                stack.callback(server.wait_for_the_end)
                stack.callback(server.tell_to_end)
            return server

        yield start


@pytest.fixture
def held(settings: Settings) -> Iterator[Held]:
    """One of two places, so that two clouds that are held take all."""
    application = Held(settings.model_copy(update={"queue": 0}))
    yield application
    application.go.set()
    application.close()


@pytest.fixture
def channel(start: Callable[..., Server]) -> Iterator[grpc.Channel]:
    with grpc.insecure_channel(start().address) as channel:
        yield channel


@pytest.fixture
def stub(channel: grpc.Channel) -> ShapeConceptsServiceStub:
    return ShapeConceptsServiceStub(channel)


@pytest.fixture
def held_stub(start: Callable[..., Server], held: Held) -> Iterator[ShapeConceptsServiceStub]:
    with grpc.insecure_channel(start(held).address) as channel:
        yield ShapeConceptsServiceStub(channel)
        held.go.set()
