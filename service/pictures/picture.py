"""What is drawn of a cloud and its answer, whatever the format: points with their colours, and the answer beside them.

A scene makes a picture of the whole and one of each object.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from service.answer import Answer
from service.clouds.scene_cloud import SceneCloud
from service.explanation import Explanation
from service.pictures.learnt import Learnt, called
from service.pictures.painting import Colouring, by_concept, by_height, by_object, by_segment, by_word
from service.scene_answer import AnsweredObject, SceneAnswer

MOST_POINTS = 40_000  # of a cloud, drawn
CONCEPTS = 10  # listed beside a cloud
SAMPLE = 2000  # points whose neighbours tell how far apart they are

Thumbnail = Callable[[int], NDArray[np.uint8]]  # the picture (48, 48) of a training object
Ask = Callable[[Answer], Learnt]  # what was learnt by the model that answered


@dataclass(frozen=True)
class Picture:
    """A cloud and its answer.

    Attributes:
        title: the cloud's file, and of a scene the object.
        answer: with its explanation; None of a whole scene, and of an object that could not be answered.
        notes: what else there is to say, in sentences.
        points: (M, 3) float32, metres: x right, y down, z forward of a camera that is upright.
        of: how many points the cloud has; M of them are drawn.
        spacing: the median distance of neighbouring points, metres.
        segments: (M,) int16: the segment of each point, -1 for none.
        colourings: the ways to colour them, the first one first.
        bars: of each concept of the answer, how close it is: 1 the closest of its time, 0 the farthest.
        concept_colours: hexadecimal, of each concept of the answer.
        thumbnails: (48, 48) uint8 of each training object that the explanation names, by its number.
    """

    title: str
    answer: Answer | None
    notes: tuple[str, ...]
    points: NDArray[np.float32]
    of: int
    spacing: float
    segments: NDArray[np.int16]
    colourings: tuple[Colouring, ...]
    bars: tuple[float, ...] = ()
    concept_colours: tuple[str, ...] = ()
    thumbnails: dict[int, NDArray[np.uint8]] = field(default_factory=dict)


def draw_cloud(title: str, sent: SceneCloud, answer: Answer, ask: Ask, thumbnail: Thumbnail) -> Picture:
    """The picture of a cloud of one object.

    Args:
        title: of the picture.
        sent: the cloud.
        answer: to it, with its explanation and the segments of its points.
        ask: tells what the model learnt that answered.
        thumbnail: tells the picture of a training object.
    """
    points = sent.cloud.points
    return _draw(title, points, -points[:, 1], _measured(answer.point_segments, sent), answer, ask, thumbnail)


def draw_scene(title: str, sent: SceneCloud, answer: SceneAnswer, ask: Ask, thumbnail: Thumbnail) -> list[Picture]:
    """The picture of a scene as a whole, and one of each object. Arguments are those of `draw_cloud`."""
    up = sent.pose.rotation.T @ np.array(answer.plane.normal)
    height = sent.cloud.points @ up + answer.plane.sensor_height_m
    points = (sent.cloud.points @ _upright(up).T).astype(np.float32)
    objects = _measured(answer.point_objects, sent)
    kept = _thinned(len(points))
    names = tuple(_titled(one) for one in answer.objects)
    whole = Picture(
        title,
        None,
        (f"{len(names)} objects on a plane {answer.plane.sensor_height_m:.2f} m below the sensor.", *answer.warnings),
        points[kept],
        len(points),
        _spacing(points[kept]),
        objects[kept].astype(np.int16),
        (by_object(objects[kept], names), by_height(height[kept])),
    )
    pictures = [whole]
    for one in answer.objects:
        own = np.flatnonzero(objects == one.number)
        own_title = f"{title}, object {one.number}"
        if one.answer is None:
            pictures.append(_unanswered(own_title, points[own], height[own], one))
        else:
            segments = np.array(one.answer.point_segments)
            pictures.append(_draw(own_title, points[own], height[own], segments, one.answer, ask, thumbnail))
    return pictures


def _draw(
    title: str,
    points: NDArray[np.float32],
    height: NDArray[np.floating],
    segments: NDArray[np.int64],
    answer: Answer,
    ask: Ask,
    thumbnail: Thumbnail,
) -> Picture:
    """A picture of an object's points (N, 3), with their heights (N,) in metres and their segments (N,)."""
    kept = _thinned(len(points))
    shown, why = segments[kept], answer.explanation
    assert why is not None, "a picture is drawn of an answer with its explanation"
    learnt = ask(answer)
    notes = [*answer.warnings]
    if answer.truncated:
        notes.append("There were more constellations than are looked at; the smallest were left out.")
    return Picture(
        title,
        answer,
        tuple(notes),
        points[kept],
        len(points),
        _spacing(points[kept]),
        shown.astype(np.int16),
        (
            by_segment(shown, why),
            by_concept(shown, why, learnt),
            by_word(shown, why),
            by_height(height[kept]),
        ),
        learnt.closeness(answer),
        learnt.colours([concept.id for concept in answer.concepts]),
        {number: thumbnail(number) for number in sorted(set(_named(why)))},
    )


def _unanswered(title: str, points: NDArray[np.float32], height: NDArray[np.floating], one: AnsweredObject) -> Picture:
    kept = _thinned(len(points))
    none = np.full(len(kept), -1, np.int16)
    why = f"Not answered: {one.error.detail}" if one.error else "Not answered."
    return Picture(
        title, None, (why,), points[kept], len(points), _spacing(points[kept]), none, (by_height(height[kept]),)
    )


def _named(why: Explanation) -> Iterable[int]:
    """The training objects that an explanation names."""
    near = [each.nearest for each in why.concepts] + [each.nearest for each in why.vertices]
    return (one.object for likenesses in (*near, why.wholes) for one in likenesses)


def _measured(of_points: list[int] | None, sent: SceneCloud) -> NDArray[np.int64]:
    """What is told of the points of a file, of those that were measured."""
    told = np.array(of_points, dtype=np.int64)
    return told if sent.cloud.measured is None else told[sent.cloud.measured]


def _thinned(count: int) -> NDArray[np.int64]:
    """The points that are drawn: all, or a draw that is the same each time."""
    if count <= MOST_POINTS:
        return np.arange(count)
    return np.sort(np.random.default_rng(0).choice(count, MOST_POINTS, replace=False))


def _spacing(points: NDArray[np.float32]) -> float:
    probes = points[:: max(1, len(points) // SAMPLE)]
    return float(np.median(cKDTree(points).query(probes, k=2)[0][:, 1])) if len(points) > 1 else 0.001


def _upright(up: NDArray[np.float64]) -> NDArray[np.float64]:
    """The axes right, down and forward (rows, (3, 3)) of an upright camera that looks as the sensor does."""
    down = -up / np.linalg.norm(up)
    forward = np.array([0.0, 0.0, 1.0]) - down[2] * down
    if np.linalg.norm(forward) < 1e-3:  # the sensor looks straight down
        forward = np.array([0.0, 1.0, 0.0]) - down[1] * down
    forward /= np.linalg.norm(forward)
    return np.stack([np.cross(down, forward), down, forward])


def _titled(one: AnsweredObject) -> str:
    """An object with the name of its best concept, if that has one."""
    best = one.answer.concepts[0] if one.answer and one.answer.concepts else None
    return f"object {one.number}" + (f", {called(best)}" if best else "")
