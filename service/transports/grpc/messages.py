"""Messages of the wire <-> what the application takes and gives. Nowhere else is one converted into the other."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from google.protobuf.message import Message
from google.rpc import error_details_pb2 as details
from google.rpc import status_pb2
from grpc import StatusCode

from service.answer import Answer
from service.application import CloudFile
from service.catalogue import ConceptList
from service.clouds import DepthCamera, Viewpoint
from service.clouds.npy import of_points
from service.engine.errors import InvalidParameter, UnreadableCloud
from service.model_cases import ModelSummary
from service.model_file import Manifest
from service.scene_answer import SceneAnswer
from service.transports import errors
from service.transports.grpc.generated.shapeconcepts.v1 import (
    answer_pb2,
    cloud_pb2,
    model_pb2,
    scene_pb2,
    service_pb2,
)

DOMAIN = "shape-concepts"
LONGEST_DETAIL = 1000  # bytes; with much more, clients would refuse the metadata in which errors are told
LONGEST_NAMES = {"model": 200, "alias": 63}  # characters
BYTES_OF_POINT = 12


def to_cloud(message: cloud_pb2.Cloud) -> CloudFile:
    """The cloud of a request; not yet read.

    Raises:
        UnreadableCloud: packed points that are not three float32 each.
        InvalidParameter: a viewpoint that is no pose, or a camera that is none.
    """
    unit = message.unit or None
    viewpoint = _to_viewpoint(message.viewpoint) if message.HasField("viewpoint") else None
    if message.WhichOneof("content") == "points":
        return CloudFile(_as_npy(message.points.xyz), "npy", unit=unit, viewpoint=viewpoint)
    file = message.file
    camera = _to_camera(file.camera) if file.HasField("camera") else None
    return CloudFile(file.data, file.format or None, file.name, unit, viewpoint, camera, file.mask or None)


def to_options(message: answer_pb2.Options) -> dict[str, Any]:
    """What `Application.respond` takes beside the cloud, by name.

    Raises:
        InvalidParameter: a name that is too long to be one.
    """
    return to_reference(message) | {
        "time": to_time(message),
        "top": _optional(message, "top"),
        "stimuli": message.stimuli,
        "explain": message.explain,
        "segments": message.segments,
    }


def to_time(message: answer_pb2.Options | service_pb2.ListConceptsRequest) -> float | None:
    """The filtration time that is asked for, if one is."""
    return _optional(message, "time")


def to_reference(
    message: answer_pb2.Options | service_pb2.GetModelRequest | service_pb2.ListConceptsRequest,
) -> dict[str, Any]:
    """Which model is meant, as `Application.which` takes it.

    Raises:
        InvalidParameter: a name that is too long to be one.
    """
    for field, longest in LONGEST_NAMES.items():
        if (length := len(getattr(message, field))) > longest:
            raise InvalidParameter(f"The {field} has at most {longest} characters, not {length}.")
    return {
        "model": message.model or None,
        "version": _optional(message, "version"),
        "alias": _optional(message, "alias"),
    }


def from_answer(answer: Answer) -> answer_pb2.Answer:
    """An answer; the message has the names of its fields."""
    facts = vars(answer) | {"concepts": [vars(concept) for concept in answer.concepts]}  # a dump takes twice as long
    for part in ("stimuli", "explanation"):
        facts[part] = facts[part] and facts[part].model_dump()
    return answer_pb2.Answer(**facts)


def from_scene(answer: SceneAnswer) -> scene_pb2.SceneAnswer:
    """The answer to a scene; the messages have the names of its fields."""
    facts = answer.model_dump()
    for one in facts["objects"]:
        one["box"]["axes"] = dict(zip(("length", "width", "height"), one["box"]["axes"], strict=True))
    return scene_pb2.SceneAnswer(**facts)


def from_summary(summary: ModelSummary) -> model_pb2.ModelSummary:
    """A model of the store."""
    return model_pb2.ModelSummary(**summary.model_dump())


def from_manifest(manifest: Manifest) -> model_pb2.Manifest:
    """How a version of a model was made."""
    facts = manifest.model_dump(mode="json", exclude={"created", "contents"})
    contents = {name: model_pb2.Content(**content.model_dump()) for name, content in manifest.contents.items()}
    return model_pb2.Manifest(**facts, created=manifest.created, contents=contents)


def from_concepts(concepts: ConceptList) -> model_pb2.ConceptList:
    """The concepts of a version; the messages have the names of its fields."""
    return model_pb2.ConceptList(**concepts.model_dump())


def to_problem(document: Mapping[str, Any], status: errors.Status) -> service_pb2.Problem:
    """A problem document, for one cloud of several."""
    problem = service_pb2.Problem(**document, code=code_of(status).value[0])
    problem.detail = _shortened(problem.detail)
    if status.retry:
        problem.retry_delay.FromSeconds(status.retry)
    return problem


def to_status(document: Mapping[str, Any], status: errors.Status, request_id: str) -> status_pb2.Status:
    """A problem document, for a call that failed: its detail is the message, the rest an ErrorInfo."""
    rest = {name: str(value) for name, value in document.items() if name != "detail"}
    reason = document["type"].rpartition(":")[2].replace("-", "_").upper()
    said: list[Message] = [
        details.ErrorInfo(reason=reason, domain=DOMAIN, metadata=rest),
        details.RequestInfo(request_id=request_id),
    ]
    if status.retry:
        retry = details.RetryInfo()
        retry.retry_delay.FromSeconds(status.retry)
        said.append(retry)
    told = status_pb2.Status(code=code_of(status).value[0], message=_shortened(document["detail"]))
    for detail in said:
        told.details.add().Pack(detail)
    return told


def code_of(status: errors.Status) -> StatusCode:
    """The status code of an error."""
    return StatusCode[status.grpc]


def _to_viewpoint(message: cloud_pb2.Viewpoint) -> Viewpoint:
    position, turn = message.position, message.orientation
    where = (position.x, position.y, position.z)
    if not message.HasField("orientation"):
        return Viewpoint(where)
    return Viewpoint(where, (turn.w, turn.x, turn.y, turn.z))


def _to_camera(message: cloud_pb2.DepthCamera) -> DepthCamera:
    return DepthCamera(message.fx, message.fy, message.cx, message.cy, _optional(message, "scale"))


def _as_npy(xyz: bytes) -> bytes:
    """Packed points as the bytes of an NPY file: they are then read, and limited, as any file."""
    if len(xyz) % BYTES_OF_POINT:
        raise UnreadableCloud(
            f"packed points are (N, 3) float32, {BYTES_OF_POINT} bytes each, but there were {len(xyz)} bytes; "
            "send x, y and z of every point and nothing else"
        )
    return of_points(xyz)


def _optional(message: Message, field: str) -> Any:
    return getattr(message, field) if message.HasField(field) else None


def _shortened(text: str) -> str:
    octets = text.encode()
    if len(octets) <= LONGEST_DETAIL:
        return text
    return octets[:LONGEST_DETAIL].decode(errors="ignore") + "..."
