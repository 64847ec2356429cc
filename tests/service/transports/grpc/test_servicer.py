"""ShapeConceptsService, asked over gRPC."""

from __future__ import annotations

import io
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import grpc
import httpx
import numpy as np
import pytest
from google.protobuf.json_format import MessageToDict

from service.clouds import write_ply
from service.engine.cloud import PointCloud
from service.transports.grpc.generated.shapeconcepts.v1.answer_pb2 import Answer, Options
from service.transports.grpc.generated.shapeconcepts.v1.cloud_pb2 import (
    Cloud,
    CloudFile,
    DepthCamera,
    Orientation,
    PackedPoints,
    Position,
    Viewpoint,
)
from service.transports.grpc.generated.shapeconcepts.v1.scene_pb2 import SceneAnswer
from service.transports.grpc.generated.shapeconcepts.v1.service_pb2 import (
    RespondBatchRequest,
    RespondRequest,
    RespondSceneRequest,
    RespondStreamRequest,
)
from service.transports.grpc.servicer import AT_ONCE
from tests.service.tabletop.seen import set_table
from tests.service.transports.grpc.conftest import HELD, Held, Server
from tests.service.transports.grpc.sent import Stub, as_file, as_points


def told(answer: Answer) -> dict[str, Any]:
    """An answer as REST would write it, without its timings."""
    written = MessageToDict(answer, preserving_proto_field_name=True, always_print_fields_with_no_presence=True)
    for concept in written["concepts"]:
        concept.setdefault("name", None)
    if not written["point_segments"]:
        del written["point_segments"]
    assert all(spent >= 0 for spent in written.pop("timings_ms").values())
    return written


def over_rest(client: httpx.Client, cloud: PointCloud, **params: Any) -> dict[str, Any]:
    response = client.post("/v1/responses", content=write_ply(cloud), params=params)
    assert response.status_code == 200, response.text
    answer: dict[str, Any] = response.json()
    del answer["timings_ms"]
    return answer


@pytest.mark.parametrize(
    "options", [{}, {"stimuli": True, "explain": True, "segments": True}, {"time": 0.8, "top": 2, "model": "tiny:1"}]
)
def test_an_answer_is_that_of_rest_to_the_last_bit(
    stub: Stub, client: httpx.Client, clouds: list[PointCloud], options: dict[str, Any]
) -> None:
    for cloud in clouds[:3]:
        expected = over_rest(client, cloud, **options)
        for sent in (as_file(cloud), as_points(cloud)):
            response = stub.Respond(RespondRequest(cloud=sent, options=Options(**options)))
            assert told(response.answer) == expected
            assert "decode" in response.answer.timings_ms


def told_of_scene(scene: SceneAnswer) -> dict[str, Any]:
    """The answer to a scene as REST would write it, without its timings."""
    written = MessageToDict(scene, preserving_proto_field_name=True, always_print_fields_with_no_presence=True)
    for message, one in zip(scene.objects, written["objects"], strict=True):
        one["box"]["axes"] = list(one["box"]["axes"].values())
        one["answer"] = told(message.answer) if message.HasField("answer") else None
        for field in ("error", "at_border"):
            one.setdefault(field, None)
    if not written["point_objects"]:
        del written["point_objects"]
    assert "tabletop" in written.pop("timings_ms")
    return written


@pytest.mark.parametrize("options", [{}, {"top": 2, "time": 0.5}, {"segments": True, "stimuli": True}])
def test_a_scene_is_answered_as_over_rest_to_the_last_bit(
    stub: Stub, client: httpx.Client, options: dict[str, Any]
) -> None:
    cloud = set_table("kinect").cloud
    response = client.post("/v1/responses", content=write_ply(cloud), params={"scene": True} | options)
    expected = response.json()
    for part in (expected, *(one["answer"] for one in expected["objects"])):
        del part["timings_ms"]
    assert len(expected["objects"]) == 3
    for sent in (as_file(cloud), as_points(cloud)):
        asked = Options(**options)
        assert told_of_scene(stub.RespondScene(RespondSceneRequest(cloud=sent, options=asked)).answer) == expected
    requests = [
        RespondStreamRequest(sequence=1, cloud=as_file(cloud), options=asked, scene=True),
        RespondStreamRequest(sequence=2, cloud=as_file(cloud), options=asked),
    ]
    whole, alone = stub.RespondStream(iter(requests))
    assert told_of_scene(whole.scene_answer) == expected
    assert alone.HasField("answer")


def test_a_unit_and_a_viewpoint_mean_what_they_mean_over_rest(
    stub: Stub, client: httpx.Client, clouds: list[PointCloud]
) -> None:
    moved = PointCloud((clouds[0].points * 1000 + [100, 200, 300]).astype(np.float32))
    expected = over_rest(client, moved, unit="mm", viewpoint="100,200,300,0.6,0,0,0.8")
    pose = Viewpoint(position=Position(x=100, y=200, z=300), orientation=Orientation(w=0.6, z=0.8))
    for sent in (as_file(moved), as_points(moved)):
        sent.unit = "mm"
        sent.viewpoint.CopyFrom(pose)
        assert told(stub.Respond(RespondRequest(cloud=sent)).answer) == expected


def test_a_depth_image_is_answered_as_its_points(stub: Stub) -> None:
    """A ball, 12 cm across, 0.8 m before a camera of 525 pixels focal length."""
    v, u = np.mgrid[:160, :160]
    ray = np.stack([(u - 80) / 525, (v - 80) / 525, np.ones_like(u)], axis=-1)
    middle, square = ray[..., 2] * 0.8, (ray**2).sum(axis=-1)
    depth = (middle - np.sqrt(np.maximum(middle**2 - square * (0.8**2 - 0.06**2), 0))) / square
    depth[middle**2 < square * (0.8**2 - 0.06**2)] = 0
    buffer = io.BytesIO()
    np.save(buffer, depth.astype("<f4"))
    image = CloudFile(data=buffer.getvalue(), camera=DepthCamera(fx=525, fy=525, cx=80, cy=80))
    answer = stub.Respond(RespondRequest(cloud=Cloud(file=image))).answer
    xyz = (ray * depth.astype(np.float32)[..., None])[depth > 0].astype("<f4")
    expected = stub.Respond(RespondRequest(cloud=Cloud(points=PackedPoints(xyz=xyz.tobytes())))).answer
    assert answer.extent_m == pytest.approx(expected.extent_m, rel=1e-5)
    np.testing.assert_allclose(answer.responses, expected.responses, rtol=1e-3)


def test_a_batch_gives_each_cloud_its_answer_or_its_error_in_order(stub: Stub, clouds: list[PointCloud]) -> None:
    alone = [told(stub.Respond(RespondRequest(cloud=as_file(cloud))).answer) for cloud in clouds[:5]]
    bad = Cloud(file=CloudFile(data=b"GIF89a\0", name="cat.gif"))
    sent = [bad, *map(as_file, clouds[:5]), Cloud(), bad]
    responses = list(stub.RespondBatch(RespondBatchRequest(clouds=sent)))
    assert [response.index for response in responses] == list(range(len(sent)))
    assert [told(response.answer) for response in responses[1:-2]] == alone
    for index, kind, status in (
        (0, "unsupported-format", 415),
        (-2, "empty-cloud", 422),
        (-1, "unsupported-format", 415),
    ):
        problem = responses[index].problem
        assert (problem.type, problem.status) == (f"urn:shape-concepts:error:{kind}", status)
        assert problem.code == grpc.StatusCode.INVALID_ARGUMENT.value[0]
        assert not problem.HasField("retry_delay")
    assert list(stub.RespondBatch(RespondBatchRequest())) == []


def test_a_stream_answers_clouds_in_their_order_with_their_numbers(stub: Stub, clouds: list[PointCloud]) -> None:
    alone = [told(stub.Respond(RespondRequest(cloud=as_file(cloud))).answer) for cloud in clouds]
    requests = [RespondStreamRequest(sequence=2**64 - 1 - i, cloud=as_points(cloud)) for i, cloud in enumerate(clouds)]
    requests.insert(3, RespondStreamRequest(sequence=7))
    responses = list(stub.RespondStream(iter(requests)))
    assert [response.sequence for response in responses] == [request.sequence for request in requests]
    assert responses.pop(3).problem.type == "urn:shape-concepts:error:empty-cloud"
    assert [told(response.answer) for response in responses] == alone


def test_a_stream_answers_a_cloud_before_the_next_one_is_sent(stub: Stub, clouds: list[PointCloud]) -> None:
    answered = threading.Semaphore(1)

    def requests() -> Iterator[RespondStreamRequest]:
        for number, cloud in enumerate(clouds):
            assert answered.acquire(timeout=20)
            yield RespondStreamRequest(sequence=number, cloud=as_points(cloud))

    for response in stub.RespondStream(requests()):
        assert response.HasField("answer")
        answered.release()


def test_a_stream_that_is_not_answered_holds_the_client_back(
    held_stub: Stub, held: Held, clouds: list[PointCloud]
) -> None:
    """Its messages are nearly as large as a message may be, so that the buffers between here and there hold few."""
    xyz = "".join(f"{x} {y} {z}\n" for x, y, z in clouds[0].points.tolist()).encode()
    file = CloudFile(data=xyz + (b"#" * 999 + b"\n") * ((2**20 - len(xyz) - 500) // 1000), format="xyz", name=HELD)
    count, sent = 60, []

    def requests() -> Iterator[RespondStreamRequest]:
        for number in range(count):
            sent.append(number)
            yield RespondStreamRequest(sequence=number, cloud=Cloud(file=file), options=Options(top=1))

    call = held_stub.RespondStream(requests())
    for _ in range(2):  # as many as there are workers
        assert held.held.acquire(timeout=20)
    time.sleep(1.5)
    assert AT_ONCE <= len(sent) < count / 2
    held.go.set()
    responses = list(call)
    assert [response.sequence for response in responses] == list(range(count))
    assert all(response.HasField("answer") for response in responses)


def test_a_client_is_held_back_even_if_its_clouds_are_small(
    held_stub: Stub, held: Held, clouds: list[PointCloud]
) -> None:
    """As a live stream goes: what is sent is not seconds old when it is worked on."""
    small = PointCloud(clouds[0].points[::10])
    file, sent = CloudFile(data=write_ply(small)), []

    def requests() -> Iterator[RespondStreamRequest]:
        for number in range(1000):
            file.name = HELD if number == 200 else ""
            sent.append(number)
            yield RespondStreamRequest(sequence=number, cloud=Cloud(file=file), options=Options(top=1))

    call = held_stub.RespondStream(requests())
    for number in range(200):
        assert next(call).sequence == number
        assert len(sent) - number < 40
    assert held.held.acquire(timeout=20)
    time.sleep(0.5)
    assert len(sent) < 240
    call.cancel()


def test_many_clients_get_the_answers_of_one(start: Callable[..., Server], clouds: list[PointCloud]) -> None:
    address = start().address
    with grpc.insecure_channel(address) as channel:
        alone = [told(Stub(channel).Respond(RespondRequest(cloud=as_file(cloud))).answer) for cloud in clouds]

    def ask(number: int) -> None:
        with grpc.insecure_channel(address, [("grpc.use_local_subchannel_pool", 1)]) as channel:
            requests = (RespondStreamRequest(sequence=i, cloud=as_points(cloud)) for i, cloud in enumerate(clouds))
            for response in Stub(channel).RespondStream(requests):
                if response.HasField("answer"):
                    assert told(response.answer) == alone[response.sequence]
                else:
                    assert response.problem.type == "urn:shape-concepts:error:overloaded"

    with ThreadPoolExecutor(4) as threads:
        list(threads.map(ask, range(4)))
