"""Access keys over gRPC."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import grpc
import pytest
from google.rpc.error_details_pb2 import RetryInfo
from grpc_health.v1.health_pb2 import HealthCheckRequest
from grpc_health.v1.health_pb2_grpc import HealthStub
from grpc_status import rpc_status

from service.application import Application
from service.engine.cloud import PointCloud
from service.keys import KeyStore
from service.settings import Settings
from service.transports.grpc.generated.shapeconcepts.v1.cloud_pb2 import Cloud, PackedPoints
from service.transports.grpc.generated.shapeconcepts.v1.service_pb2 import (
    DESCRIPTOR,
    ListModelsRequest,
    RespondBatchRequest,
    RespondRequest,
    RespondSceneRequest,
    RespondStreamRequest,
)
from service.transports.grpc.generated.shapeconcepts.v1.service_pb2_grpc import ShapeConceptsServiceStub
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


Metadata = list[tuple[str, str]]


def bearing(text: str) -> Metadata:
    return [("authorization", f"Bearer {text}")]


def packed(cloud: PointCloud, points: int) -> Cloud:
    """The cloud thinned out to so many points."""
    xyz = cloud.points[:: len(cloud.points) // points][:points]
    return Cloud(points=PackedPoints(xyz=xyz.astype("<f4").tobytes()))


def refused(call: Callable[[], Any]) -> grpc.RpcError:
    with pytest.raises(grpc.RpcError) as caught:
        call()
    return caught.value


def test_a_key_has_as_many_points_answered_as_it_may(
    guarded: grpc.Channel, settings: Settings, clouds: list[PointCloud]
) -> None:
    stub = ShapeConceptsServiceStub(guarded)
    metadata = bearing(KeyStore(settings.store).create("few", ("answer",), max_points=500).text)
    fits, large = packed(clouds[0], 500), packed(clouds[0], 501)
    assert stub.Respond(RespondRequest(cloud=fits), metadata=metadata).answer.concepts
    error = refused(lambda: stub.Respond(RespondRequest(cloud=large), metadata=metadata))
    assert "over the limit of 500; crop" in error.details()
    error = refused(lambda: stub.RespondScene(RespondSceneRequest(cloud=large), metadata=metadata))
    assert "over the limit of 500; crop" in error.details()
    batch = stub.RespondBatch(RespondBatchRequest(clouds=[fits, large, fits]), metadata=metadata)
    requests = [RespondStreamRequest(cloud=cloud) for cloud in (fits, large, fits)]
    (scene,) = stub.RespondStream(iter([RespondStreamRequest(cloud=large, scene=True)]), metadata=metadata)
    assert scene.problem.type.endswith("too-many-points")
    for responses in (list(batch), list(stub.RespondStream(iter(requests), metadata=metadata))):
        assert [response.HasField("answer") for response in responses] == [True, False, True]
        assert responses[1].problem.type.endswith("too-many-points")


def test_a_key_sends_messages_as_large_as_it_may(
    guarded: grpc.Channel, settings: Settings, clouds: list[PointCloud]
) -> None:
    stub = ShapeConceptsServiceStub(guarded)
    keys = KeyStore(settings.store)
    cloud = packed(clouds[0], 500)
    size = RespondRequest(cloud=cloud).ByteSize()
    fits, short = (bearing(keys.create("a", ("answer",), max_body=size - less).text) for less in (0, 1))
    assert stub.Respond(RespondRequest(cloud=cloud), metadata=fits).answer.concepts
    calls: list[Callable[[], Any]] = [
        lambda: stub.Respond(RespondRequest(cloud=cloud), metadata=short),
        lambda: list(stub.RespondBatch(RespondBatchRequest(clouds=[cloud] * 2), metadata=short)),
        lambda: list(stub.RespondStream(iter([RespondStreamRequest(sequence=1, cloud=cloud)]), metadata=short)),
    ]
    for call in calls:
        error = refused(call)
        assert error.code() == grpc.StatusCode.RESOURCE_EXHAUSTED
        assert f"larger than the {size - 1} that are taken. Send fewer points" in error.details()


def test_what_came_before_a_message_too_large_is_answered(
    guarded: grpc.Channel, settings: Settings, clouds: list[PointCloud]
) -> None:
    metadata = bearing(KeyStore(settings.store).create("a", ("answer",), max_body=6100).text)
    requests = [RespondStreamRequest(cloud=packed(clouds[0], points)) for points in (500, 500, 600)]
    answered = []

    def ask() -> None:
        for response in ShapeConceptsServiceStub(guarded).RespondStream(iter(requests), metadata=metadata):
            answered.append(response.HasField("answer"))

    assert refused(ask).code() == grpc.StatusCode.RESOURCE_EXHAUSTED
    assert answered == [True, True]


def test_a_key_sends_as_many_clouds_at_a_time_as_it_may(guarded: grpc.Channel, settings: Settings) -> None:
    stub = ShapeConceptsServiceStub(guarded)
    metadata = bearing(KeyStore(settings.store).create("two", ("answer",), max_batch=2).text)
    assert len(list(stub.RespondBatch(RespondBatchRequest(clouds=[Cloud()] * 2), metadata=metadata))) == 2
    error = refused(lambda: list(stub.RespondBatch(RespondBatchRequest(clouds=[Cloud()] * 3), metadata=metadata)))
    assert error.code() == grpc.StatusCode.INVALID_ARGUMENT
    assert "at most 2 clouds, not 3: send several" in error.details()


def test_of_a_stream_each_cloud_counts_and_the_stream_goes_on(
    guarded: grpc.Channel, settings: Settings, clouds: list[PointCloud]
) -> None:
    metadata = bearing(KeyStore(settings.store).create("slow", ("answer",), rate=0.1).text)
    requests = [RespondStreamRequest(sequence=number, cloud=packed(clouds[0], 500)) for number in range(6)]
    first, *others = ShapeConceptsServiceStub(guarded).RespondStream(iter(requests), metadata=metadata)
    assert first.HasField("answer")
    assert [response.sequence for response in others] == [1, 2, 3, 4, 5]
    for response in others:
        problem = response.problem
        assert (problem.status, problem.type.rpartition(":")[2]) == (429, "rate-exceeded")
        assert problem.code == grpc.StatusCode.RESOURCE_EXHAUSTED.value[0]
        assert 5 < problem.retry_delay.seconds <= 10
        assert "0.1 requests a second" in problem.detail


def test_a_stream_is_answered_again_when_its_key_may(
    guarded: grpc.Channel, settings: Settings, clouds: list[PointCloud]
) -> None:
    metadata = bearing(KeyStore(settings.store).create("a", ("answer",), rate=1).text)
    answered = threading.Event()

    def requests() -> Iterator[RespondStreamRequest]:
        yield RespondStreamRequest(cloud=packed(clouds[0], 500))
        answered.wait(20)
        for pause in (0, 1.1):
            time.sleep(pause)
            yield RespondStreamRequest(cloud=packed(clouds[0], 500))

    outcomes = []
    for response in ShapeConceptsServiceStub(guarded).RespondStream(requests(), metadata=metadata):
        outcomes.append(response.HasField("answer"))
        answered.set()
    assert outcomes in ([True, False, True], [True, True, True])  # the second if the first took a second


def test_a_batch_counts_as_many_as_it_has_clouds(guarded: grpc.Channel, settings: Settings) -> None:
    stub, keys = ShapeConceptsServiceStub(guarded), KeyStore(settings.store)
    slow, hasty = (bearing(keys.create("a", ("answer",), rate=rate).text) for rate in (0.1, 20))
    assert len(list(stub.RespondBatch(RespondBatchRequest(clouds=[Cloud()] * 5), metadata=slow))) == 5
    error = refused(lambda: stub.ListModels(ListModelsRequest(), metadata=slow))
    assert error.code() == grpc.StatusCode.RESOURCE_EXHAUSTED
    assert 30 < seconds_to_wait(error) <= 50
    assert len(list(stub.RespondBatch(RespondBatchRequest(clouds=[Cloud()] * 20), metadata=hasty))) == 20
    error = refused(lambda: list(stub.RespondBatch(RespondBatchRequest(clouds=[Cloud()] * 20), metadata=hasty)))
    assert error.code() == grpc.StatusCode.RESOURCE_EXHAUSTED
    assert seconds_to_wait(error) == 1


def seconds_to_wait(error: grpc.RpcError) -> int:
    """What an error says when to try again."""
    (retry,) = (detail for detail in rpc_status.from_call(error).details if detail.Is(RetryInfo.DESCRIPTOR))
    found = RetryInfo()
    retry.Unpack(found)
    return int(found.retry_delay.seconds)
