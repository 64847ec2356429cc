"""What is said about a whole scene: where its objects are, what each resembles, and what was left out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from service.answer import Answer
from service.clouds.scene_cloud import SceneCloud
from service.engine.errors import ShapeConceptsError
from service.tabletop import REASONS, Scene, SceneObject

Triple = tuple[float, float, float]


class Refusal(BaseModel):
    """Why an object was not answered."""

    model_config = ConfigDict(frozen=True)

    type: str = Field(description="stable name of the kind of error, e.g. too-few-points")
    detail: str = Field(description="what was wrong, and what to try")


class SupportingPlane(BaseModel):
    """The plane that bears the objects: the largest that something stands on. n.p + d = 0, in the cloud's own frame."""

    model_config = ConfigDict(frozen=True)

    normal: Triple = Field(description="n, of unit length, towards the side of the sensor; the cloud's own frame")
    offset_m: float = Field(description="d, metres, in the cloud's own frame")
    sensor_height_m: float = Field(ge=0, description="how high the sensor is above the plane, metres")
    points: int = Field(ge=0, description="points of the cloud that are part of the plane")


class StandingBox(BaseModel):
    """The box of least ground that holds an object and stands upright on the plane."""

    model_config = ConfigDict(frozen=True)

    centre_m: Triple = Field(description="its middle, metres, in the cloud's own frame")
    size_m: Triple = Field(description="length and width along the plane, and height across it, metres")
    axes: tuple[Triple, Triple, Triple] = Field(
        description="directions of length, width and height, of unit length, in the cloud's own frame; right-handed"
    )


class AnsweredObject(BaseModel):
    """One object of a scene: where it is, and which concepts it resembles."""

    model_config = ConfigDict(frozen=True)

    number: int = Field(ge=0, description="of the object in this scene, from 0, the nearest to the sensor first")
    position_m: Triple = Field(description="middle of what was seen of it, metres, in the cloud's own frame")
    sensor_position_m: Triple = Field(
        description="the same in the sensor's frame: x right, y down, z forward; equal where the sensor is the origin"
    )
    distance_m: float = Field(ge=0, description="from the sensor, metres")
    box: StandingBox = Field(description="around it")
    height_m: tuple[float, float] = Field(description="of its lowest and highest point above the plane, metres")
    points: int = Field(ge=1, description="points of the cloud that are part of it")
    touches: list[int] = Field(description="numbers of the objects that stand so near that they may touch it")
    hidden_by: list[int] = Field(
        description="numbers of the nearer objects that are seen right beside it, so that they may hide a part of it"
    )
    at_border: bool | None = Field(
        None,
        description="whether it reaches the border of the image, so that a part may be missing; null where the cloud "
        "is no image row by row",
    )
    beyond_edge: bool = Field(
        description="whether something adjoins it that is not over the plane, so that it may be cut there"
    )
    answer: Answer | None = Field(
        None,
        description="which concepts it resembles, seen by a camera that is turned to it: what an explanation says of "
        "places is in that camera's frame; null if it could not be answered",
    )
    error: Refusal | None = Field(None, description="why it could not be answered; null if it was")


class LeftOut(BaseModel):
    """Points that are neither plane nor object, for one reason."""

    model_config = ConfigDict(frozen=True)

    reason: str = Field(description=f"one of {', '.join(REASONS)}")
    detail: str = Field(description="the reason in words")
    points: int = Field(ge=1, description="how many points")
    pieces: int = Field(ge=0, description="how many connected pieces they make; 0 where that was not looked at")


class SceneAnswer(BaseModel):
    """The objects that stand on a plane, each with its answer.

    The points of the plane, of the objects and of what was left out are all that were measured.
    """

    model_config = ConfigDict(frozen=True)

    model: str = Field(description="name of the model that answered")
    version: int = Field(ge=1, description="its version")
    plane: SupportingPlane = Field(description="what the objects stand on")
    objects: list[AnsweredObject] = Field(description="nearest to the sensor first")
    left_out: list[LeftOut] = Field(description="what is neither plane nor object, by reason")
    warnings: list[str] = Field(description="what is odd about the scene, in sentences")
    timings_ms: dict[str, float] = Field(description="how long each stage took for all objects together, milliseconds")
    point_objects: list[int] | None = Field(
        None,
        description="number of the object of each point of the cloud as it was sent, in its order, if `segments` asked "
        "for that; -1 for points that were not measured or are part of none",
        exclude_if=lambda value: value is None,
    )


def refuse(error: ShapeConceptsError) -> Refusal:
    """An error as it is told of one object."""
    return Refusal(type=error.type_name(), detail=str(error))


def compose_scene(
    sent: SceneCloud,
    scene: Scene,
    answers: list[Answer | Refusal],
    model: tuple[str, int],
    timings_ms: dict[str, float],
    *,
    points: bool | NDArray[np.int32],
) -> SceneAnswer:
    """The answer that a scene makes.

    Args:
        sent: the cloud, and the pose of its sensor.
        scene: what was found in it.
        answers: of each object, or why there is none.
        model: name and version that gave them.
        timings_ms: of each stage, milliseconds.
        points: whether the object of each point is part of the answer; or the places in the file of some points, of
            which alone it is.
    """
    normal = sent.pose.rotation @ scene.plane.normal
    origin = sent.to_own_frame(np.zeros(3))
    return SceneAnswer(
        model=model[0],
        version=model[1],
        plane=SupportingPlane(
            normal=_triple(normal),
            offset_m=float(scene.plane.offset - normal @ origin),
            sensor_height_m=scene.plane.offset,
            points=scene.inliers,
        ),
        objects=[
            _tell(number, found, answer, sent)
            for number, (found, answer) in enumerate(zip(scene.objects, answers, strict=True))
        ],
        left_out=[
            LeftOut(reason=left.reason, detail=REASONS[left.reason], points=left.points, pieces=left.pieces)
            for left in scene.left_out
        ],
        warnings=list(scene.warnings),
        timings_ms=timings_ms,
        point_objects=None if points is False else _point_objects(sent, scene, points),
    )


def _tell(number: int, found: SceneObject, answer: Answer | Refusal, sent: SceneCloud) -> AnsweredObject:
    length, width, height = (sent.pose.rotation @ axis for axis in found.box.axes)
    return AnsweredObject(
        number=number,
        position_m=_triple(sent.to_own_frame(found.centroid)),
        sensor_position_m=_triple(found.centroid),
        distance_m=float(np.linalg.norm(found.centroid)),
        box=StandingBox(
            centre_m=_triple(sent.to_own_frame(found.box.centre)),
            size_m=_triple(found.box.size),
            axes=(_triple(length), _triple(width), _triple(height)),
        ),
        height_m=(float(found.height[0]), float(found.height[1])),
        points=len(found.indices),
        touches=list(found.touches),
        hidden_by=list(found.hidden_by),
        at_border=found.at_border,
        beyond_edge=found.beyond_edge,
        answer=answer if isinstance(answer, Answer) else None,
        error=None if isinstance(answer, Answer) else answer,
    )


def _point_objects(sent: SceneCloud, scene: Scene, points: bool | NDArray[np.int32]) -> list[int]:
    numbers = np.full(len(sent.cloud.points), -1)
    for number, found in enumerate(scene.objects):
        numbers[found.indices] = number
    if sent.cloud.measured is not None:
        of_file = np.full(len(sent.cloud.measured), -1)
        of_file[sent.cloud.measured] = numbers
        numbers = of_file
    return list((numbers if points is True else numbers[points]).tolist())


def _triple(vector: NDArray[np.float64]) -> Triple:
    x, y, z = vector.tolist()
    return x, y, z
