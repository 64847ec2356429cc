"""What is refused over gRPC, and how it is told."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from typing import Any

import grpc
import numpy as np
import pytest

from service.application import Application
from service.engine.cloud import PointCloud
from service.settings import Settings
from service.transports.grpc.generated.shapeconcepts.v1.answer_pb2 import Options
from service.transports.grpc.generated.shapeconcepts.v1.cloud_pb2 import (
    Cloud,
    Orientation,
    PackedPoints,
    Viewpoint,
)
from service.transports.grpc.generated.shapeconcepts.v1.service_pb2 import (
    DESCRIPTOR,
    GetModelRequest,
    ListConceptsRequest,
    RespondBatchRequest,
    RespondRequest,
    RespondSceneRequest,
    RespondStreamRequest,
)
from service.transports.grpc.guard import SERVICE
from tests.service.transports.grpc.conftest import Server
from tests.service.transports.grpc.sent import XYZ, Stub, as_file, file, refused


@pytest.mark.parametrize(("given", "taken"), [("robot-7.42", True), ("not one", False)])
def test_the_id_of_a_request_is_taken_over_if_it_is_harmless(stub: Stub, given: str, taken: bool) -> None:
    with pytest.raises(grpc.RpcError) as caught:
        stub.GetModel(GetModelRequest(model="nobody"), metadata=[("x-request-id", given)])
    assert (dict(caught.value.trailing_metadata())["x-request-id"] == given) == taken


def points(xyz: bytes) -> Cloud:
    return Cloud(points=PackedPoints(xyz=xyz))


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


def test_a_fault_is_logged_whole_and_answered_plainly(
    settings: Settings, start: Callable[..., Server], caplog: pytest.LogCaptureFixture
) -> None:
    class Faulty(Application):
        def which(self, *asked: Any, **more: Any) -> tuple[str, int]:
            raise RuntimeError("the secret inside")

    application = Faulty(settings)
    with grpc.insecure_channel(start(application).address) as channel, caplog.at_level(logging.ERROR):
        error, info = refused(lambda: Stub(channel).ListConcepts(ListConceptsRequest()))
    assert (error.code(), info.reason) == (grpc.StatusCode.INTERNAL, "INTERNAL")
    assert "secret" not in str(error)
    assert "the secret inside" in caplog.text
    assert dict(error.trailing_metadata())["x-request-id"] in caplog.text
    application.close()
