"""The server as a whole: health, reflection, its port, and how it ends."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import grpc
import pytest
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from grpc_health.v1.health_pb2 import HealthCheckRequest, HealthCheckResponse
from grpc_health.v1.health_pb2_grpc import HealthStub
from grpc_reflection.v1alpha.proto_reflection_descriptor_database import ProtoReflectionDescriptorDatabase

from service.application import Application
from service.clouds import write_ply
from service.engine.cloud import PointCloud
from service.engine.model import ShapeModel
from service.settings import Settings
from service.store import ModelStore
from service.transports.grpc.generated.shapeconcepts.v1.cloud_pb2 import Cloud, CloudFile
from service.transports.grpc.generated.shapeconcepts.v1.service_pb2 import RespondRequest, RespondStreamRequest
from service.transports.grpc.generated.shapeconcepts.v1.service_pb2_grpc import ShapeConceptsServiceStub
from service.transports.grpc.guard import SERVICE
from service.transports.grpc.jobs import SERVICE as JOBS
from tests.service.transports.grpc.conftest import HELD, Held, Server

SERVING, NOT_SERVING = HealthCheckResponse.SERVING, HealthCheckResponse.NOT_SERVING


def becomes(channel: grpc.Channel, status: int) -> bool:
    """Whether all that has a health gets this one within a few seconds."""
    until = time.monotonic() + 10
    while time.monotonic() < until:
        if {HealthStub(channel).Check(HealthCheckRequest(service=name)).status for name in ("", SERVICE)} == {status}:
            return True
        time.sleep(0.05)
    return False


def test_a_server_with_a_model_is_healthy(channel: grpc.Channel) -> None:
    assert becomes(channel, SERVING)
    with pytest.raises(grpc.RpcError) as caught:
        HealthStub(channel).Check(HealthCheckRequest(service="nothing"))
    assert caught.value.code() == grpc.StatusCode.NOT_FOUND


def test_a_server_is_healthy_as_soon_as_there_is_a_model(
    start: Callable[..., Server], settings: Settings, tmp_path: Path, model: ShapeModel
) -> None:
    application = Application(settings.model_copy(update={"store": str(tmp_path / "later"), "built_in": False}))
    with grpc.insecure_channel(start(application).address) as channel:
        watched = HealthStub(channel).Watch(HealthCheckRequest(service=SERVICE))
        assert next(watched).status == NOT_SERVING
        assert becomes(channel, NOT_SERVING)
        ModelStore(tmp_path / "later").publish(model, name="tiny", seed=7, source={})
        assert next(watched).status == SERVING
        assert becomes(channel, SERVING)
    application.close()


def test_health_is_told_at_once_while_the_service_is_at_its_limit(
    start: Callable[..., Server], held: Held, clouds: list[PointCloud]
) -> None:
    with grpc.insecure_channel(start(held).address) as channel:
        assert becomes(channel, SERVING)
        calls = ask(channel, clouds[0], held.pool.places)
        for _ in calls:
            assert held.held.acquire(timeout=20)
        began = time.monotonic()
        for _ in range(20):
            assert HealthStub(channel).Check(HealthCheckRequest(), timeout=5).status == SERVING
        assert (time.monotonic() - began) / 20 < 0.1
        held.go.set()
        assert all(call.result().answer.concepts for call in calls)


def ask(channel: grpc.Channel, cloud: PointCloud, times: int = 1) -> list[grpc.Future]:
    request = RespondRequest(cloud=Cloud(file=CloudFile(data=write_ply(cloud), name=HELD)))
    return [ShapeConceptsServiceStub(channel).Respond.future(request) for _ in range(times)]


def test_a_client_that_has_no_protos_learns_them_by_reflection(channel: grpc.Channel, clouds: list[PointCloud]) -> None:
    database = ProtoReflectionDescriptorDatabase(channel)
    services = {"grpc.health.v1.Health", "grpc.reflection.v1alpha.ServerReflection", SERVICE, JOBS}
    assert set(database.get_services()) == services
    pool = DescriptorPool(database)
    for name in services:
        assert pool.FindServiceByName(name).methods
    method = pool.FindServiceByName(SERVICE).FindMethodByName("Respond")
    request = GetMessageClass(method.input_type)(cloud={"file": {"data": write_ply(clouds[0])}}, options={"top": 1})
    call = channel.unary_unary(
        f"/{SERVICE}/Respond",
        request_serializer=type(request).SerializeToString,
        response_deserializer=GetMessageClass(method.output_type).FromString,
    )
    answer = call(request).answer
    assert (answer.model, len(answer.concepts)) == ("tiny", 1)


def test_an_end_finishes_what_was_accepted_and_takes_nothing_new(
    start: Callable[..., Server], held: Held, clouds: list[PointCloud]
) -> None:
    server = start(held)
    with grpc.insecure_channel(server.address) as channel:
        assert becomes(channel, SERVING)
        watched = HealthStub(channel).Watch(HealthCheckRequest())
        assert next(watched).status == SERVING
        calls = ask(channel, clouds[0], held.pool.places)
        for _ in calls:
            assert held.held.acquire(timeout=20)
        server.tell_to_end()
        assert next(watched).status == NOT_SERVING
        with grpc.insecure_channel(server.address) as other:
            refused = ask(other, clouds[0])[0].exception()
        assert refused.code() == grpc.StatusCode.UNAVAILABLE
        held.go.set()
        assert all(call.result().answer.concepts for call in calls)
        server.wait_for_the_end()
    assert server.error is None


def test_a_stream_that_is_open_at_the_end_gets_what_it_was_promised_and_is_told_to_come_again(
    start: Callable[..., Server], held: Held, clouds: list[PointCloud]
) -> None:
    server = start(held)
    called = threading.Event()  # requests may be asked for before the call is known by its name

    def requests() -> Iterator[RespondStreamRequest]:
        for number in range(2):
            yield RespondStreamRequest(
                sequence=number, cloud=Cloud(file=CloudFile(data=write_ply(clouds[0]), name=HELD))
            )
        called.wait(timeout=20)
        while server.error is None and call.is_active():
            time.sleep(0.05)

    with grpc.insecure_channel(server.address) as channel:
        call = ShapeConceptsServiceStub(channel).RespondStream(requests())
        called.set()
        for _ in range(2):
            assert held.held.acquire(timeout=20)
        server.tell_to_end()
        held.go.set()
        assert [next(call).HasField("answer") for _ in range(2)] == [True, True]
        with pytest.raises(grpc.RpcError) as caught:
            next(call)
        assert caught.value.code() == grpc.StatusCode.UNAVAILABLE
        began = time.monotonic()
        server.wait_for_the_end()
        assert time.monotonic() - began < 5


def test_an_end_does_not_wait_for_ever(start: Callable[..., Server], held: Held, clouds: list[PointCloud]) -> None:
    server = start(held, grace=0.3)
    with grpc.insecure_channel(server.address) as channel:
        (call,) = ask(channel, clouds[0])
        assert held.held.acquire(timeout=20)
        began = time.monotonic()
        server.tell_to_end()
        server.wait_for_the_end()
        assert time.monotonic() - began < 5
        assert call.exception().code() in (grpc.StatusCode.CANCELLED, grpc.StatusCode.UNAVAILABLE)
        assert held.stopped.acquire(timeout=5)


def test_a_taken_port_ends_the_process(
    start: Callable[..., Server], settings: Settings, caplog: pytest.LogCaptureFixture
) -> None:
    taken = start().address.rpartition(":")[2]  # by a server of the same kind, which would share it if it could
    second = Application(settings.model_copy(update={"grpc_port": int(taken)}))
    error = start(second).error
    second.close()
    assert isinstance(error, SystemExit)
    assert error.code == 1
    assert f"127.0.0.1:{taken}" in caplog.text
    assert "--grpc-port" in caplog.text


def test_gRPC_can_be_switched_off(start: Callable[..., Server], settings: Settings) -> None:
    off = Application(settings.model_copy(update={"grpc_port": -1}))
    assert start(off).address == "127.0.0.1:None"
    off.close()


def test_an_address_of_IPv6_can_be_listened_on(start: Callable[..., Server], settings: Settings) -> None:
    try:
        socket.create_server(("::1", 0), family=socket.AF_INET6).close()
    except OSError:
        pytest.skip("there is no IPv6 here")
    six = Application(settings.model_copy(update={"host": "::1"}))
    with grpc.insecure_channel(start(six).address.replace("127.0.0.1", "[::1]")) as channel:
        assert becomes(channel, SERVING)
    six.close()
