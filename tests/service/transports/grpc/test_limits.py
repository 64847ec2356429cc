"""Limits, deadlines and clients that go away, over gRPC."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import grpc
import pytest
from google.rpc import error_details_pb2 as details
from grpc_status import rpc_status

from service.engine.cloud import PointCloud
from service.settings import Settings
from service.transports.grpc.generated.shapeconcepts.v1.service_pb2 import (
    ListModelsRequest,
    RespondBatchRequest,
    RespondRequest,
    RespondSceneRequest,
    RespondStreamRequest,
)
from tests.service.tabletop.seen import set_table
from tests.service.transports.grpc.conftest import HELD, Held, Server
from tests.service.transports.grpc.sent import XYZ, Stub, as_file, refused


def fill(stub: Stub, held: Held, cloud: PointCloud, **given: Any) -> list[Any]:
    """Calls that take all places of the pool, once they are at work."""
    calls = [stub.Respond.future(RespondRequest(cloud=as_file(cloud, HELD)), **given) for _ in range(held.pool.places)]
    for _ in calls:
        assert held.held.acquire(timeout=20)
    return calls


def answered_soon(stub: Stub, cloud: PointCloud) -> bool:
    """Whether the pool is free again within a few seconds."""
    until = time.monotonic() + 5
    while time.monotonic() < until:
        try:
            return bool(stub.Respond(RespondRequest(cloud=as_file(cloud))).answer.concepts)
        except grpc.RpcError as error:
            if error.code() != grpc.StatusCode.RESOURCE_EXHAUSTED:
                raise
            time.sleep(0.02)
    return False


def test_a_service_at_its_limit_refuses_at_once_and_says_when_to_try_again(
    held_stub: Stub, held: Held, clouds: list[PointCloud]
) -> None:
    calls = fill(held_stub, held, clouds[0])
    one = RespondRequest(cloud=as_file(clouds[0]))
    began = time.monotonic()
    for call in (
        lambda: held_stub.Respond(one),
        lambda: held_stub.RespondScene(RespondSceneRequest(cloud=one.cloud)),
        lambda: list(held_stub.RespondBatch(RespondBatchRequest(clouds=[XYZ]))),
    ):
        error, info = refused(call)
        assert (error.code(), info.reason) == (grpc.StatusCode.RESOURCE_EXHAUSTED, "OVERLOADED")
        retry = details.RetryInfo()
        assert rpc_status.from_call(error).details[2].Unpack(retry)
        assert retry.retry_delay.seconds >= 1
    (streamed,) = held_stub.RespondStream(iter([RespondStreamRequest(cloud=one.cloud)]))
    assert streamed.problem.retry_delay.seconds >= 1
    assert held_stub.ListModels(ListModelsRequest()).models
    assert time.monotonic() - began < 5
    held.go.set()
    assert all(call.result().answer.concepts for call in calls)


def test_a_batch_that_was_accepted_is_answered_in_whatever_places_there_are(
    held_stub: Stub, held: Held, clouds: list[PointCloud]
) -> None:
    batch = held_stub.RespondBatch(RespondBatchRequest(clouds=[as_file(cloud, HELD) for cloud in clouds[:5]]))
    for _ in range(held.pool.places):
        assert held.held.acquire(timeout=20)
    error, _ = refused(lambda: held_stub.Respond(RespondRequest(cloud=as_file(clouds[0]))))
    assert error.code() == grpc.StatusCode.RESOURCE_EXHAUSTED
    held.go.set()
    assert all(response.HasField("answer") for response in batch)
    assert held_stub.Respond(RespondRequest(cloud=as_file(clouds[0]))).answer.concepts


def test_bodies_are_counted_together(
    start: Callable[..., Server], settings: Settings, clouds: list[PointCloud]
) -> None:
    """Two of these fill the memory that bodies may take, a third is refused although the pool has places."""
    held = Held(settings.model_copy(update={"max_bodies": settings.max_body, "queue": 8}))
    cloud = as_file(clouds[0], HELD)
    cloud.file.data += bytes(settings.max_body // 2 - 1000 - len(cloud.file.data))
    with grpc.insecure_channel(start(held).address) as channel:
        stub = Stub(channel)
        calls = [stub.Respond.future(RespondRequest(cloud=cloud)) for _ in range(2)]
        for _ in calls:
            assert held.held.acquire(timeout=20)
        error, info = refused(lambda: stub.Respond(RespondRequest(cloud=cloud)))
        assert (error.code(), info.reason) == (grpc.StatusCode.RESOURCE_EXHAUSTED, "OVERLOADED")
        held.go.set()
        assert all(call.result().answer.concepts for call in calls)
        assert stub.Respond(RespondRequest(cloud=cloud)).answer.concepts
    held.close()


def test_a_deadline_that_passes_ends_the_work(held_stub: Stub, held: Held, clouds: list[PointCloud]) -> None:
    calls = fill(held_stub, held, clouds[0], timeout=1)
    for call in calls:
        assert call.exception().code() == grpc.StatusCode.DEADLINE_EXCEEDED
    assert answered_soon(held_stub, clouds[0])
    for _ in calls:
        assert held.stopped.acquire(timeout=5)


def test_a_call_that_is_cancelled_ends_the_work(held_stub: Stub, held: Held, clouds: list[PointCloud]) -> None:
    calls = fill(held_stub, held, clouds[0])
    for call in calls:
        call.cancel()
    assert answered_soon(held_stub, clouds[0])
    for _ in calls:
        assert held.stopped.acquire(timeout=5)


def test_the_work_on_a_scene_ends_when_nobody_waits_for_it(
    held_stub: Stub, held: Held, clouds: list[PointCloud]
) -> None:
    request = RespondSceneRequest(cloud=as_file(set_table().cloud, HELD))
    cancelled, late = held_stub.RespondScene.future(request), held_stub.RespondScene.future(request, timeout=1)
    for _ in range(2):
        assert held.held.acquire(timeout=20)
    cancelled.cancel()
    assert late.exception().code() == grpc.StatusCode.DEADLINE_EXCEEDED
    for _ in range(2):
        assert held.stopped.acquire(timeout=5)
    assert answered_soon(held_stub, clouds[0])


@pytest.mark.parametrize("kind", ["batch", "stream"])
def test_a_batch_or_stream_that_is_cancelled_ends_the_work(
    held_stub: Stub, held: Held, clouds: list[PointCloud], kind: str
) -> None:
    sent = [as_file(cloud, HELD) for cloud in clouds[:5]]
    if kind == "batch":
        call = held_stub.RespondBatch(RespondBatchRequest(clouds=sent))
    else:
        call = held_stub.RespondStream(RespondStreamRequest(cloud=cloud) for cloud in sent)
    for _ in range(2):
        assert held.held.acquire(timeout=20)
    call.cancel()
    assert answered_soon(held_stub, clouds[0])
    for _ in range(2):
        assert held.stopped.acquire(timeout=5)
