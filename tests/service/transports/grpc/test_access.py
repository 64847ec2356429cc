"""Access keys over gRPC."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import grpc
import pytest
from grpc_health.v1.health_pb2 import HealthCheckRequest
from grpc_health.v1.health_pb2_grpc import HealthStub
from grpc_status import rpc_status

from service.application import Application
from service.keys import KeyStore
from service.settings import Settings
from service.transports.grpc.generated.shapeconcepts.v1.service_pb2 import DESCRIPTOR, ListModelsRequest
from service.transports.grpc.guard import SERVICE
from tests.service.transports.grpc.conftest import Server

METHODS = tuple(DESCRIPTOR.services_by_name["ShapeConceptsService"].methods_by_name)


@pytest.fixture
def guarded(settings: Settings, start: Callable[..., Server]) -> Iterator[grpc.Channel]:
    """A channel to a server that asks for keys."""
    application = Application(settings.model_copy(update={"access": "keys"}))
    with grpc.insecure_channel(start(application).address) as channel:
        yield channel
    application.close()


def code_of(channel: grpc.Channel, authorization: str | None, method: str = "ListModels") -> str:
    """What a call with this key ends with."""
    metadata = [("authorization", authorization)] if authorization else []
    asked = channel.stream_stream(f"/{SERVICE}/{method}", request_serializer=ListModelsRequest.SerializeToString)
    try:
        list(asked(iter([ListModelsRequest()]), metadata=metadata, timeout=20))
    except grpc.RpcError as error:
        status = rpc_status.from_call(error)
        assert status is not None
        assert len(status.details) >= 2
        return str(error.code().name)
    return "OK"


@pytest.mark.parametrize("method", METHODS)
def test_without_a_key_nothing_but_health_is_told(guarded: grpc.Channel, method: str) -> None:
    for wrong in (None, "Bearer sc_wrong", "Basic eDp5", "Bearer", "x"):
        assert code_of(guarded, wrong, method) == "UNAUTHENTICATED"
    assert HealthStub(guarded).Check(HealthCheckRequest()).status


def test_a_key_is_refused_before_anything_of_a_message_is_received(guarded: grpc.Channel) -> None:
    never = threading.Event()

    def nothing() -> Iterator[Any]:
        never.wait(30)
        yield from ()

    began = time.monotonic()
    with pytest.raises(grpc.RpcError) as caught:
        list(guarded.stream_stream(f"/{SERVICE}/Respond")(nothing(), timeout=20))
    never.set()
    assert caught.value.code() == grpc.StatusCode.UNAUTHENTICATED
    assert time.monotonic() - began < 3


def test_a_key_is_let_in_and_its_scope_holds(guarded: grpc.Channel, settings: Settings) -> None:
    keys = KeyStore(settings.store)
    answering, training = keys.create("a", ("answer",)).text, keys.create("b", ("train",)).text
    for method in ("ListModels", "GetModel", "ListConcepts"):
        assert code_of(guarded, f"Bearer {answering}", method) == "OK"
        assert code_of(guarded, f"Bearer {training}", method) == "PERMISSION_DENIED"


def test_a_key_that_is_used_too_much_is_told_when_to_come_back(guarded: grpc.Channel, settings: Settings) -> None:
    text = KeyStore(settings.store).create("hasty", ("answer",), rate=0.1).text
    assert [code_of(guarded, f"Bearer {text}") for _ in range(3)] == ["OK", "RESOURCE_EXHAUSTED", "RESOURCE_EXHAUSTED"]


def test_calls_that_are_over_are_under_way_no_more(guarded: grpc.Channel, settings: Settings) -> None:
    text = KeyStore(settings.store).create("one", ("answer",), concurrency=1).text
    never = threading.Event()

    def nothing() -> Iterator[Any]:
        never.wait(30)
        yield from ()

    stream = guarded.stream_stream(f"/{SERVICE}/RespondStream")
    for _ in range(3):
        open_one = None
        until = time.monotonic() + 10
        while code_of(guarded, f"Bearer {text}") != "RESOURCE_EXHAUSTED":
            assert time.monotonic() < until
            if open_one is None or open_one.done():  # or refused, since the other call came first
                open_one = stream(nothing(), metadata=[("authorization", f"Bearer {text}")])
        open_one.cancel()
        while code_of(guarded, f"Bearer {text}") != "OK":
            assert time.monotonic() < until
    never.set()
