"""What the messages hold is what the application takes and gives."""

from __future__ import annotations

import types
import typing
from typing import Any

import numpy as np
import pytest
from google.protobuf.descriptor import Descriptor
from google.protobuf.json_format import MessageToDict
from google.protobuf.message import Message
from google.rpc import error_details_pb2 as details
from pydantic import BaseModel

from service import clouds as formats
from service.answer import Answer
from service.application import CloudFile
from service.catalogue import ConceptList
from service.engine.errors import InvalidParameter, Overloaded, RateExceeded, ShapeConceptsError, UnreadableCloud
from service.model_cases import ModelSummary
from service.model_file import Content, Manifest
from service.scene_answer import SceneAnswer
from service.transports import errors
from service.transports.grpc import messages
from service.transports.grpc.generated.shapeconcepts.v1 import answer_pb2, cloud_pb2, model_pb2, scene_pb2
from service.transports.rest import examples


def records(kind: Any) -> list[type[BaseModel]]:
    """The records that a field of this type holds."""
    if isinstance(kind, type) and not isinstance(kind, types.GenericAlias) and issubclass(kind, BaseModel):
        return [kind]
    return [record for part in typing.get_args(kind) for record in records(part)]


def check_same_fields(record: type[BaseModel], message: Descriptor) -> None:
    assert set(record.model_fields) == set(message.fields_by_name), record.__name__
    for name, field in record.model_fields.items():
        for inner in records(field.annotation):
            kind = message.fields_by_name[name].message_type
            if kind.file.package == message.file.package and not kind.GetOptions().map_entry:
                check_same_fields(inner, kind)


def test_messages_have_all_fields_of_what_they_tell() -> None:
    """A field that is added to an answer has to be added to the proto."""
    check_same_fields(Answer, answer_pb2.Answer.DESCRIPTOR)
    check_same_fields(SceneAnswer, scene_pb2.SceneAnswer.DESCRIPTOR)
    check_same_fields(ModelSummary, model_pb2.ModelSummary.DESCRIPTOR)
    check_same_fields(ConceptList, model_pb2.ConceptList.DESCRIPTOR)
    check_same_fields(Manifest, model_pb2.Manifest.DESCRIPTOR)
    check_same_fields(Content, model_pb2.Content.DESCRIPTOR)


def plain(message: Message) -> dict[str, Any]:
    return MessageToDict(message, preserving_proto_field_name=True, always_print_fields_with_no_presence=True)


def test_floats_are_exact() -> None:
    awkward = [0.1, 1 / 3, 5e-324, -1.7976931348623157e308, 0.9319999999999999]
    answer = Answer(**{**examples.ANSWER, "responses": awkward, "distances": awkward})
    read = answer_pb2.Answer.FromString(messages.from_answer(answer).SerializeToString())
    assert list(read.responses) == list(read.distances) == awkward
    assert read.time == answer.time
    assert dict(read.timings_ms) == answer.timings_ms


def test_what_was_not_asked_for_is_unset() -> None:
    message = messages.from_answer(Answer(**examples.ANSWER))
    assert not message.HasField("stimuli")
    assert not message.HasField("explanation")
    assert not message.concepts[0].HasField("name")
    named = {**examples.ANSWER["concepts"][0], "name": "mug"}
    message = messages.from_answer(Answer(**{**examples.ANSWER, "concepts": [named]}, point_segments=[-1, 2]))
    assert message.concepts[0].name == "mug"
    assert list(message.point_segments) == [-1, 2]


def test_of_an_object_of_a_scene_there_is_the_answer_or_the_error() -> None:
    answered = examples.SCENE_ANSWER["objects"][0]
    refused = answered | {
        "answer": None,
        "error": {"type": "too-few-points", "detail": "12 points"},
        "at_border": False,
    }
    scene = SceneAnswer(**examples.SCENE_ANSWER | {"objects": [answered, refused], "point_objects": [-1, 0, 1]})
    message = messages.from_scene(scene)
    first, second = message.objects
    assert (first.WhichOneof("outcome"), second.WhichOneof("outcome")) == ("answer", "error")
    assert (first.HasField("at_border"), second.HasField("at_border"), second.at_border) == (False, True, False)
    assert (second.error.type, second.error.detail) == ("too-few-points", "12 points")
    axes = first.box.axes
    assert [list(axes.length), list(axes.width), list(axes.height)] == answered["box"]["axes"]
    assert list(message.point_objects) == [-1, 0, 1]


def test_a_manifest_is_told_whole() -> None:
    made = {"parent": "default:1", "metrics": {"knn": 0.75}, "job": "nightly"}
    manifest = Manifest(**{**examples.MANIFEST, "seed": 2**63 + 1, **made})
    message = messages.from_manifest(manifest)
    assert message.seed == 2**63 + 1
    assert message.created.ToDatetime(manifest.created.tzinfo) == manifest.created
    told, facts = plain(message), manifest.model_dump(mode="json")
    for varying in ("seed", "created", "contents"):
        del told[varying], facts[varying]
    assert told == facts
    assert message.contents["model.safetensors"].size == manifest.contents["model.safetensors"].size


POINTS = np.array([[0.1, 0.2, 0.9], [np.nan, np.nan, np.nan], [-0.3, 1e-7, 1.5]], "<f4")


def test_packed_points_are_the_points() -> None:
    cloud = messages.to_cloud(cloud_pb2.Cloud(points=cloud_pb2.PackedPoints(xyz=POINTS.tobytes()), unit="mm"))
    read = formats.read(cloud.data, cloud.format, unit=cloud.unit)
    np.testing.assert_array_equal(read.points, (POINTS[[0, 2]].astype(float) * 0.001).astype(np.float32))


def test_packed_points_that_end_within_a_point_are_refused() -> None:
    for length in (1, 11, 13):
        with pytest.raises(UnreadableCloud, match=f"{length} bytes"):
            messages.to_cloud(cloud_pb2.Cloud(points=cloud_pb2.PackedPoints(xyz=bytes(length))))


def test_a_file_comes_with_what_is_said_of_it() -> None:
    file = cloud_pb2.CloudFile(data=b"1 2 3", format="xyz", name="mug.txt")
    assert messages.to_cloud(cloud_pb2.Cloud(file=file, unit="cm")) == CloudFile(b"1 2 3", "xyz", "mug.txt", "cm")
    assert messages.to_cloud(cloud_pb2.Cloud()) == CloudFile(b"")


def test_a_depth_image_comes_with_its_camera_and_mask() -> None:
    camera = cloud_pb2.DepthCamera(fx=525, fy=520, cx=319.5, cy=239.5)
    sent = cloud_pb2.Cloud(file=cloud_pb2.CloudFile(data=b"x", format="png", camera=camera, mask=b"m"))
    cloud = messages.to_cloud(sent)
    assert (cloud.camera, cloud.mask) == (formats.DepthCamera(525, 520, 319.5, 239.5), b"m")
    sent.file.camera.scale = 0.0002
    assert messages.to_cloud(sent).camera == formats.DepthCamera(525, 520, 319.5, 239.5, 0.0002)
    for wrong in ({"fx": float("nan")}, {"cx": float("inf")}, {"scale": 0.0}):
        values = {"fx": 525, "fy": 520, "cx": 319.5, "cy": 239.5, **wrong}
        file = cloud_pb2.CloudFile(data=b"x", camera=cloud_pb2.DepthCamera(**values))
        with pytest.raises(InvalidParameter):
            messages.to_cloud(cloud_pb2.Cloud(file=file))


def test_a_viewpoint_is_a_position_and_a_turn_of_which_both_may_be_left_out() -> None:
    position = cloud_pb2.Position(x=1, y=2, z=3)
    turn = cloud_pb2.Orientation(w=0, x=1, y=0, z=0)
    for message, expected in (
        (cloud_pb2.Viewpoint(), formats.Viewpoint()),
        (cloud_pb2.Viewpoint(position=position), formats.Viewpoint((1, 2, 3))),
        (cloud_pb2.Viewpoint(orientation=turn), formats.Viewpoint(orientation=(0, 1, 0, 0))),
        (cloud_pb2.Viewpoint(position=position, orientation=turn), formats.Viewpoint((1, 2, 3), (0, 1, 0, 0))),
    ):
        assert messages.to_cloud(cloud_pb2.Cloud(viewpoint=message)).viewpoint == expected
    for wrong in (
        cloud_pb2.Viewpoint(position=cloud_pb2.Position(x=float("nan"))),
        cloud_pb2.Viewpoint(orientation=cloud_pb2.Orientation()),
    ):
        with pytest.raises(InvalidParameter):
            messages.to_cloud(cloud_pb2.Cloud(viewpoint=wrong))


def test_options_that_are_unset_are_not_zero() -> None:
    unset = messages.to_options(answer_pb2.Options())
    assert {name for name, value in unset.items() if value is not None} == {"stimuli", "explain", "segments"}
    zero = messages.to_options(answer_pb2.Options(version=0, time=0, top=0, alias=""))
    assert (zero["version"], zero["time"], zero["top"], zero["alias"]) == (0, 0, 0, "")
    for wrong in (answer_pb2.Options(model="x" * 201), answer_pb2.Options(alias="x" * 64)):
        with pytest.raises(InvalidParameter):
            messages.to_options(wrong)


@pytest.mark.parametrize("error", [Overloaded("busy"), RateExceeded("hasty", 41.5), UnreadableCloud("é" * 5000)])
def test_an_error_is_told_in_full_and_never_at_length(error: ShapeConceptsError) -> None:
    status, document = errors.status_of(error), errors.problem_of(error, "some-id")
    told = messages.to_status(document, status, "some-id")
    assert len(told.SerializeToString()) < 3000
    assert document["detail"].startswith(told.message.removesuffix("..."))
    info, request, *retry = told.details
    unpacked = details.ErrorInfo()
    assert info.Unpack(unpacked)
    assert unpacked.reason == error.type_name().replace("-", "_").upper()
    assert dict(unpacked.metadata) == {name: str(value) for name, value in document.items() if name != "detail"}
    assert request.Is(details.RequestInfo.DESCRIPTOR)
    problem = messages.to_problem(document, status)
    assert (problem.code, problem.detail) == (told.code, told.message)
    assert problem.HasField("retry_delay") == bool(retry) == bool(status.retry)
    assert problem.retry_delay.seconds == status.retry
