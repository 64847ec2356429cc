"""The ways to colour the points of a cloud, each with its legend."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from service.explanation import Explanation
from service.pictures.colours import ABSENT, STEPS, colour, scale
from service.pictures.learnt import Learnt, called


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


def by_segment(segments: NDArray[np.int64], why: Explanation) -> Colouring:
    """The segment of each point (M,), -1 for none."""
    labels = [f"segment {number}, {segment.share:.0%}" for number, segment in enumerate(why.segments)]
    return _numbered("segment", segments, range(len(labels)), [colour(k) for k in range(len(labels))], labels)


def by_concept(segments: NDArray[np.int64], why: Explanation, learnt: Learnt) -> Colouring:
    """A segment has the concept of the training object of which a part, or the whole, is most like it."""
    listed = {concept.id: concept for concept in learnt.concepts.concepts}
    owner = {number: concept.id for concept in listed.values() for number in concept.objects}
    own = np.array([owner.get(segment.nearest[0].object, -1) for segment in why.segments])
    seen = sorted(set(own.tolist()) - {-1})
    labels = [called(listed[concept]) for concept in seen]
    return _numbered("concept", _of_segments(segments, own), seen, learnt.colours(seen), labels)


def by_word(segments: NDArray[np.int64], why: Explanation) -> Colouring:
    """A segment has its visual word on the finest level of the dictionary."""
    own = np.array([segment.words[-1] for segment in why.segments])
    seen = sorted(set(own.tolist()))
    labels = [f"word {word}" for word in seen]
    return _numbered("word", _of_segments(segments, own), seen, [colour(word) for word in seen], labels)


def by_object(objects: NDArray[np.int64], labels: Sequence[str]) -> Colouring:
    """The object of a scene that each point (M,) is part of, -1 for none."""
    return _numbered("object", objects, range(len(labels)), [colour(k) for k in range(len(labels))], labels)


def by_height(height: NDArray[np.floating]) -> Colouring:
    """The height of each point (M,), metres."""
    low, high = float(height.min()), float(height.max())
    share = (height - low) / max(high - low, 1e-9)
    return Colouring(
        "height", (share * (STEPS - 1)).astype(np.uint16), scale(), ("low", f"high, {100 * (high - low):.1f} cm")
    )


def _of_segments(segments: NDArray[np.int64], own: NDArray[np.int64]) -> NDArray[np.int64]:
    """What is told of each segment (S,), of the points (M,) by their segments; -1 for points of none."""
    return np.where(segments < 0, -1, own[segments])


def _numbered(
    by: str, values: NDArray[np.int64], known: Sequence[int], colours: Sequence[str], labels: Sequence[str]
) -> Colouring:
    """Points coloured by numbers; the last colour is that of all numbers that are not known."""
    places = np.full(len(values), len(known))
    for place, value in enumerate(known):
        places[values == value] = place
    return Colouring(by, places.astype(np.uint16), (*colours, ABSENT), (*labels, f"no {by}"))
