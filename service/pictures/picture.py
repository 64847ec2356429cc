"""What is drawn of a cloud and its answer, whatever the format: points with their colours, and the answer beside them.

A scene makes a picture of the whole and one of each object.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from service.answer import Answer, Concept
from service.catalogue import ConceptList, LearnedConcept
from service.clouds.scene_cloud import SceneCloud
from service.explanation import Explanation, FiredVertex
from service.pictures.colours import ABSENT, STEPS, colour, scale
from service.scene_answer import AnsweredObject, SceneAnswer

MOST_POINTS = 40_000  # of a cloud, drawn
CONCEPTS = 10  # listed beside a cloud
SAMPLE = 2000  # points whose neighbours tell how far apart they are

Thumbnail = Callable[[int], NDArray[np.uint8]]  # the picture (48, 48) of a training object
Concepts = Callable[[Answer], ConceptList]  # those at an answer's time


class Colouring(NamedTuple):
    """One way to colour the points.

    Attributes:
        by: what tells the colour: segment, concept, word, object or height.
        values: (M,) uint16: of each point, its place among `colours`.
        colours: hexadecimal.
        labels: of each colour; of a scale the lowest and the highest value.
    """

    by: str
    values: NDArray[np.uint16]
    colours: tuple[str, ...]
    labels: tuple[str, ...]


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
    thumbnails: dict[int, NDArray[np.uint8]]


def draw_cloud(title: str, sent: SceneCloud, answer: Answer, concepts: Concepts, thumbnail: Thumbnail) -> Picture:
    """The picture of a cloud of one object.

    Args:
        title: of the picture.
        sent: the cloud.
        answer: to it, with its explanation and the segments of its points.
        concepts: tells the concepts at the answer's time.
        thumbnail: tells the picture of a training object.
    """
    points = sent.cloud.points
    return _draw(title, points, -points[:, 1], _measured(answer.point_segments, sent), answer, concepts, thumbnail)


def draw_scene(
    title: str, sent: SceneCloud, answer: SceneAnswer, concepts: Concepts, thumbnail: Thumbnail
) -> list[Picture]:
    """The picture of a scene as a whole, and one of each object. Arguments are those of `draw_cloud`."""
    up = sent.pose.rotation.T @ np.array(answer.plane.normal)
    height = sent.cloud.points @ up + answer.plane.sensor_height_m
    points = (sent.cloud.points @ _upright(up).T).astype(np.float32)
    objects = _measured(answer.point_objects, sent)
    kept = _thinned(len(points))
    names = tuple(_titled(one) for one in answer.objects)
    by_object = Colouring("object", *_numbered(objects[kept], range(len(names)), names, "the table, and what else"))
    whole = Picture(
        title,
        None,
        (f"{len(names)} objects on a plane {answer.plane.sensor_height_m:.2f} m below the sensor.", *answer.warnings),
        points[kept],
        len(points),
        _spacing(points[kept]),
        objects[kept].astype(np.int16),
        (by_object, _by_height(height[kept])),
        {},
    )
    pictures = [whole]
    for one in answer.objects:
        own = np.flatnonzero(objects == one.number)
        called = f"{title}, object {one.number}"
        if one.answer is None:
            pictures.append(_unanswered(called, points[own], height[own], one))
        else:
            segments = np.array(one.answer.point_segments)
            pictures.append(_draw(called, points[own], height[own], segments, one.answer, concepts, thumbnail))
    return pictures


def called(concept: Concept | LearnedConcept) -> str:
    """What a concept is called: by the name that people gave it, which others may share, and by its number."""
    return f"{concept.name} ({concept.id})" if concept.name else f"concept {concept.id}"


def motif(fired: FiredVertex) -> str:
    """What a motif that fired is called: by the segments that fired it."""
    numbers = ", ".join(map(str, fired.segments))
    return f"segment{'s' * (len(fired.segments) > 1)} {numbers}, motif level {fired.level}"


def closeness(answer: Answer) -> list[float]:
    """How close each listed concept is, the length of its bar: 1 of the closest, 0 at the mean of all or beyond."""
    near, mean = min(answer.responses), float(np.mean(answer.responses))
    return [max(0.0, (mean - concept.response) / ((mean - near) or 1.0)) for concept in answer.concepts]


def _draw(
    title: str,
    points: NDArray[np.float32],
    height: NDArray[np.floating],
    segments: NDArray[np.int64],
    answer: Answer,
    concepts: Concepts,
    thumbnail: Thumbnail,
) -> Picture:
    """A picture of an object's points (N, 3), with their heights (N,) in metres and their segments (N,)."""
    kept = _thinned(len(points))
    shown, why = segments[kept], answer.explanation
    assert why is not None, "a picture is drawn of an answer with its explanation"
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
            _by_segment(shown, why),
            _by_concept(shown, why, concepts(answer)),
            _by_word(shown, why),
            _by_height(height[kept]),
        ),
        {number: thumbnail(number) for number in sorted(set(_named(why)))},
    )


def _unanswered(title: str, points: NDArray[np.float32], height: NDArray[np.floating], one: AnsweredObject) -> Picture:
    kept = _thinned(len(points))
    none = np.full(len(kept), -1, np.int16)
    why = f"Not answered: {one.error.detail}" if one.error else "Not answered."
    return Picture(
        title, None, (why,), points[kept], len(points), _spacing(points[kept]), none, (_by_height(height[kept]),), {}
    )


def _by_segment(segments: NDArray[np.int64], why: Explanation) -> Colouring:
    labels = [f"segment {number}, {segment.share:.0%}" for number, segment in enumerate(why.segments)]
    return Colouring("segment", *_numbered(segments, range(len(labels)), labels, "no segment"))


def _by_concept(segments: NDArray[np.int64], why: Explanation, listed: ConceptList) -> Colouring:
    """A segment has the concept of the training object of which a part, or the whole, is most like it."""
    place = {number: k for k, concept in enumerate(listed.concepts) for number in concept.objects}
    own = np.array([place.get(segment.nearest[0].object, -1) for segment in why.segments])
    seen = sorted(set(own.tolist()) - {-1})
    labels = [called(listed.concepts[k]) for k in seen]
    return Colouring("concept", *_numbered(_of_segments(segments, own), seen, labels, "no concept"))


def _by_word(segments: NDArray[np.int64], why: Explanation) -> Colouring:
    """A segment has its visual word on the finest level of the dictionary."""
    own = np.array([segment.words[-1] for segment in why.segments])
    seen = sorted(set(own.tolist()))
    return Colouring(
        "word", *_numbered(_of_segments(segments, own), seen, [f"word {word}" for word in seen], "no word")
    )


def _by_height(height: NDArray[np.floating]) -> Colouring:
    low, high = float(height.min()), float(height.max())
    share = (height - low) / max(high - low, 1e-9)
    labels = (
        (f"{100 * low:.0f} cm", f"{100 * high:.0f} cm") if low >= 0 else ("lowest", f"{100 * (high - low):.0f} cm up")
    )
    return Colouring("height", (share * (STEPS - 1)).astype(np.uint16), scale(), labels)


def _of_segments(segments: NDArray[np.int64], own: NDArray[np.int64]) -> NDArray[np.int64]:
    """What is told of each segment (S,), of the points (M,) by their segments; -1 for points of none."""
    return np.where(segments < 0, -1, own[segments])


def _numbered(
    values: NDArray[np.int64], known: Iterable[int], labels: Iterable[str], otherwise: str
) -> tuple[NDArray[np.uint16], tuple[str, ...], tuple[str, ...]]:
    """Places of values among those known, their colours and labels; the last is that of all other values."""
    ordered = np.array(list(known), dtype=np.int64)
    places = np.full(len(values), len(ordered))
    for place, value in enumerate(ordered.tolist()):
        places[values == value] = place
    colours = tuple(colour(place) for place in range(len(ordered)))
    return places.astype(np.uint16), (*colours, ABSENT), (*labels, otherwise)


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
