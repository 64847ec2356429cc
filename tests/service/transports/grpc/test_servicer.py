"""ShapeConceptsService, asked over gRPC."""

from __future__ import annotations

import io
import logging
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
from google.rpc import error_details_pb2 as details
from grpc_status import rpc_status

from service.application import Application
from service.clouds import write_ply
from service.engine.cloud import PointCloud
from service.model_cases import ModelSummary
from service.settings import Settings
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
    DESCRIPTOR,
    GetModelRequest,
    ListConceptsRequest,
    ListModelsRequest,
    RespondBatchRequest,
    RespondRequest,
    RespondSceneRequest,
    RespondStreamRequest,
)
from service.transports.grpc.generated.shapeconcepts.v1.service_pb2_grpc import ShapeConceptsServiceStub
from service.transports.grpc.guard import SERVICE
from service.transports.grpc.servicer import AT_ONCE
from tests.service.tabletop.seen import set_table
from tests.service.transports.grpc.conftest import HELD, Held, Server

Stub = ShapeConceptsServiceStub


def as_file(cloud: PointCloud, name: str = "") -> Cloud:
    return Cloud(file=CloudFile(data=write_ply(cloud), name=name))


def as_points(cloud: PointCloud) -> Cloud:
    return Cloud(points=PackedPoints(xyz=cloud.points.astype("<f4").tobytes()))


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


def test_models_are_listed_and_told(stub: Stub, client: httpx.Client) -> None:
    (summary,) = stub.ListModels(ListModelsRequest()).models
    assert (summary.name, list(summary.versions), dict(summary.aliases)) == ("tiny", [1], {"production": 1})
    expected = client.get("/v1/models/tiny/versions/1").json()
    for asked in ({}, {"model": "tiny"}, {"model": "tiny@production"}, {"version": 1}, {"alias": "production"}):
        manifest = stub.GetModel(GetModelRequest(**asked)).manifest
        assert (manifest.name, manifest.version, manifest.digest) == ("tiny", 1, expected["digest"])
        assert MessageToDict(manifest.counts) == expected["counts"]
        assert MessageToDict(manifest.params) == expected["params"]


@pytest.mark.parametrize("asked", [{}, {"time": 0.5}, {"time": 0}, {"model": "tiny:1"}, {"alias": "production"}])
def test_concepts_are_those_of_rest_with_their_names(
    stub: Stub, client: httpx.Client, application: Application, asked: dict[str, Any]
) -> None:
    first = client.get("/v1/models/tiny:1/concepts").json()["concepts"][0]["id"]
    application.naming.rename("tiny", 1, first, "mug")
    expected = client.get("/v1/models/tiny:1/concepts", params={k: v for k, v in asked.items() if k == "time"}).json()
    told = MessageToDict(
        stub.ListConcepts(ListConceptsRequest(**asked)).list,
        preserving_proto_field_name=True,
        always_print_fields_with_no_presence=True,
    )
    for concept in told["concepts"]:
        concept.setdefault("name", None)
    assert told == expected
    assert "time" in asked or expected["concepts"][0]["name"] == "mug"


def test_an_answer_can_be_read_by_what_is_told_of_the_concepts(stub: Stub, clouds: list[PointCloud]) -> None:
    for time_ in (None, 0.5):
        answer = stub.Respond(RespondRequest(cloud=as_file(clouds[0]), options=Options(time=time_))).answer
        told = stub.ListConcepts(ListConceptsRequest(time=time_)).list
        assert len(told.concepts) == len(answer.responses)
        sizes = {concept.id: (concept.prototypes, concept.time) for concept in told.concepts}
        responses = dict(zip((concept.id for concept in told.concepts), answer.responses, strict=True))
        for concept in answer.concepts:
            assert sizes[concept.id] == (concept.prototypes, concept.time)
            assert responses[concept.id] == concept.response


@pytest.mark.parametrize(
    ("asked", "code"),
    [
        ({"model": "nobody"}, "NOT_FOUND"),
        ({"version": 9}, "NOT_FOUND"),
        ({"time": 1.5}, "INVALID_ARGUMENT"),
        ({"time": float("nan")}, "INVALID_ARGUMENT"),
        ({"model": "../x"}, "INVALID_ARGUMENT"),
        ({"model": "x" * 1000}, "INVALID_ARGUMENT"),
    ],
)
def test_concepts_of_what_is_not_there_are_refused(stub: Stub, asked: dict[str, Any], code: str) -> None:
    error, _ = refused(lambda: stub.ListConcepts(ListConceptsRequest(**asked)))
    assert error.code().name == code


@pytest.mark.parametrize(("given", "taken"), [("robot-7.42", True), ("not one", False)])
def test_the_id_of_a_request_is_taken_over_if_it_is_harmless(stub: Stub, given: str, taken: bool) -> None:
    with pytest.raises(grpc.RpcError) as caught:
        stub.GetModel(GetModelRequest(model="nobody"), metadata=[("x-request-id", given)])
    assert (dict(caught.value.trailing_metadata())["x-request-id"] == given) == taken


def refused(call: Callable[[], Any]) -> tuple[grpc.RpcError, details.ErrorInfo]:
    with pytest.raises(grpc.RpcError) as caught:
        call()
    error = caught.value
    status = rpc_status.from_call(error)
    assert status is not None, error
    info, request = details.ErrorInfo(), details.RequestInfo()
    assert status.details[0].Unpack(info)
    assert status.details[1].Unpack(request)
    assert info.domain == "shape-concepts"
    assert dict(error.trailing_metadata())["x-request-id"] == request.request_id
    assert info.metadata["instance"] == f"urn:uuid:{request.request_id}"
    assert len(error.details()) > 10
    return error, info


def file(data: bytes, format: str = "", **given: Any) -> Cloud:
    return Cloud(file=CloudFile(data=data, format=format), **given)


def points(xyz: bytes) -> Cloud:
    return Cloud(points=PackedPoints(xyz=xyz))


XYZ = file(b"0.1 0.2 0.9\n")
VAST = b"""ply
format binary_little_endian 1.0
element vertex 1000000000000
property float x
property float y
property float z
end_header
"""
REFUSED: list[tuple[str, str, str, Cloud, dict[str, Any]]] = [
    ("no cloud", "INVALID_ARGUMENT", "empty-cloud", Cloud(), {}),
    ("too few points", "INVALID_ARGUMENT", "too-few-points", XYZ, {}),
    ("no points", "INVALID_ARGUMENT", "empty-cloud", points(b""), {}),
    ("half a point", "INVALID_ARGUMENT", "unreadable-cloud", points(b"123456"), {}),
    ("all NaN", "INVALID_ARGUMENT", "no-finite-points", points(b"\xff" * 1200), {}),
    ("all equal", "INVALID_ARGUMENT", "degenerate-cloud", points(np.ones(900, "<f4").tobytes()), {}),
    ("another format", "INVALID_ARGUMENT", "unreadable-cloud", file(b"ply\n", "pcd"), {}),
    ("an unknown format", "INVALID_ARGUMENT", "unsupported-format", file(b"x", "x" * 10**5), {}),
    ("10^12 points", "INVALID_ARGUMENT", "too-many-points", file(VAST + bytes(120)), {}),
    ("an unknown unit", "INVALID_ARGUMENT", "invalid-parameter", file(b"1 2 3\n", unit="furlong"), {}),
    ("no turn", "INVALID_ARGUMENT", "invalid-parameter",
     file(b"1 2 3\n", viewpoint=Viewpoint(orientation=Orientation())), {}),
    ("an unknown model", "NOT_FOUND", "model-not-found", XYZ, {"model": "nobody"}),
    ("an unknown alias", "NOT_FOUND", "model-not-found", XYZ, {"alias": "nobody"}),
    ("version 0", "NOT_FOUND", "model-not-found", XYZ, {"version": 0}),
    ("a large version", "NOT_FOUND", "model-not-found", XYZ, {"version": 99_999_999}),
    ("version 2^32 - 1", "INVALID_ARGUMENT", "invalid-parameter", XYZ, {"version": 2**32 - 1}),
    ("a malformed model", "INVALID_ARGUMENT", "invalid-parameter", XYZ, {"model": "../x"}),
    ("a long model", "INVALID_ARGUMENT", "invalid-parameter", XYZ, {"model": "x" * 10**5}),
    ("a contradiction", "INVALID_ARGUMENT", "invalid-parameter", XYZ, {"model": "tiny:1", "version": 1}),
    ("a time of 2", "INVALID_ARGUMENT", "invalid-parameter", XYZ, {"time": 2}),
    ("a time of NaN", "INVALID_ARGUMENT", "invalid-parameter", XYZ, {"time": float("nan")}),
    ("no concepts", "INVALID_ARGUMENT", "invalid-parameter", XYZ, {"top": 0}),
]  # fmt: skip


@pytest.mark.parametrize(("code", "kind", "cloud", "options"), [r[1:] for r in REFUSED], ids=[r[0] for r in REFUSED])
def test_what_cannot_be_answered_is_refused_with_its_own_problem(
    stub: Stub, code: str, kind: str, cloud: Cloud, options: dict[str, Any]
) -> None:
    asked = Options(**options)
    error, info = refused(lambda: stub.Respond(RespondRequest(cloud=cloud, options=asked)))
    assert (error.code().name, info.metadata["type"]) == (code, f"urn:shape-concepts:error:{kind}"), error.details()
    assert info.reason == kind.replace("-", "_").upper()
    (response,) = stub.RespondBatch(RespondBatchRequest(clouds=[cloud], options=asked))
    (streamed,) = stub.RespondStream(iter([RespondStreamRequest(cloud=cloud, options=asked)]))
    (scene,) = stub.RespondStream(iter([RespondStreamRequest(cloud=cloud, options=asked, scene=True)]))
    error_of_scene, info_of_scene = refused(lambda: stub.RespondScene(RespondSceneRequest(cloud=cloud, options=asked)))
    assert (error_of_scene.code(), info_of_scene.metadata["type"]) == (error.code(), scene.problem.type)
    assert scene.problem.detail == error_of_scene.details()
    assert response.problem.type == streamed.problem.type == info.metadata["type"]
    assert response.problem.detail == error.details()


def test_a_batch_of_too_many_clouds_is_refused(stub: Stub, settings: Settings) -> None:
    error, _ = refused(lambda: list(stub.RespondBatch(RespondBatchRequest(clouds=[XYZ] * (settings.max_batch + 1)))))
    assert error.code() == grpc.StatusCode.INVALID_ARGUMENT


def test_an_unknown_model_is_not_told_of(stub: Stub) -> None:
    error, _ = refused(lambda: stub.GetModel(GetModelRequest(model="nobody")))
    assert error.code() == grpc.StatusCode.NOT_FOUND


METHODS = tuple(DESCRIPTOR.services_by_name["ShapeConceptsService"].methods_by_name)


@pytest.mark.parametrize("method", METHODS)
def test_bytes_that_are_no_message_are_refused_and_nothing_breaks(
    channel: grpc.Channel, stub: Stub, clouds: list[PointCloud], method: str
) -> None:
    ask = channel.stream_stream(f"/{SERVICE}/{method}")
    whole = RespondRequest(cloud=as_file(clouds[0])).SerializeToString()
    for hostile in (b"\xff\xff\xff", b"\x0a\xff\xff\xff\xff\x0f", whole[:-7], b"\x0b" * 5000):
        error, _ = refused(lambda hostile=hostile: list(ask(iter([hostile]))))
        assert error.code() == grpc.StatusCode.INVALID_ARGUMENT
    assert stub.Respond(RespondRequest(cloud=as_file(clouds[0]))).answer.concepts


def test_a_call_without_its_message_is_refused(channel: grpc.Channel) -> None:
    error, _ = refused(lambda: list(channel.stream_stream(f"/{SERVICE}/Respond")(iter([]))))
    assert error.code() == grpc.StatusCode.INVALID_ARGUMENT
    assert list(channel.stream_stream(f"/{SERVICE}/RespondStream")(iter([]))) == []


def test_a_message_that_never_comes_is_not_waited_for(settings: Settings, start: Callable[..., Server]) -> None:
    application = Application(settings.model_copy(update={"body_timeout": 0.3}))
    never = threading.Event()

    def nothing() -> Iterator[bytes]:
        never.wait(30)
        yield from ()

    with grpc.insecure_channel(start(application).address) as channel:
        error, _ = refused(lambda: list(channel.stream_stream(f"/{SERVICE}/Respond")(nothing(), timeout=20)))
        never.set()
    assert error.code() == grpc.StatusCode.DEADLINE_EXCEEDED
    application.close()


@pytest.mark.parametrize("method", METHODS)
def test_a_message_that_is_too_large_is_refused(channel: grpc.Channel, settings: Settings, method: str) -> None:
    ask = channel.stream_stream(f"/{SERVICE}/{method}")
    with pytest.raises(grpc.RpcError) as caught:
        list(ask(iter([bytes(settings.max_body + 1)])))
    assert caught.value.code() == grpc.StatusCode.RESOURCE_EXHAUSTED


def test_a_compressed_message_is_refused_before_it_grows(channel: grpc.Channel) -> None:
    bomb = bytes(64 * 2**20)
    for compression in (grpc.Compression.Gzip, grpc.Compression.Deflate):
        with pytest.raises(grpc.RpcError) as caught:
            channel.unary_unary(f"/{SERVICE}/Respond")(bomb, compression=compression)
        assert caught.value.code() == grpc.StatusCode.UNIMPLEMENTED


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


def test_a_fault_is_logged_whole_and_answered_plainly(
    settings: Settings, start: Callable[..., Server], caplog: pytest.LogCaptureFixture
) -> None:
    class Faulty(Application):
        def models(self) -> list[ModelSummary]:
            raise RuntimeError("the secret inside")

    application = Faulty(settings)
    with grpc.insecure_channel(start(application).address) as channel, caplog.at_level(logging.ERROR):
        error, info = refused(lambda: Stub(channel).ListModels(ListModelsRequest()))
    assert (error.code(), info.reason) == (grpc.StatusCode.INTERNAL, "INTERNAL")
    assert "secret" not in str(error)
    assert "the secret inside" in caplog.text
    assert dict(error.trailing_metadata())["x-request-id"] in caplog.text
    application.close()
