"""What a model learnt, as far as an answer is drawn by it: its concepts, what they are called, and their colours."""

from __future__ import annotations

from typing import NamedTuple

from service.answer import Answer, Concept
from service.catalogue import AnnexationGraph, ConceptList, LearnedConcept
from service.explanation import FiredVertex
from service.pictures.colours import colour


class Learnt(NamedTuple):
    """What a model learnt.

    Attributes:
        concepts: those at the time of the answer that is drawn.
        graph: the annexation graph F.
    """

    concepts: ConceptList
    graph: AnnexationGraph

    def colours(self, concepts: list[int]) -> tuple[str, ...]:
        """The colours of concepts, given by their ids.

        A concept has that of the bar of the object which represents it, so that it keeps its colour as it grows. Long
        bars come first among the colours, as on the service's page.
        """
        edges, time = self.graph.edges, self.graph.time
        death = [float("inf")] * (len(edges) + 1)
        for (annexed, _), moment in zip(edges, time, strict=True):
            death[annexed] = moment
        bars = sorted(range(len(death)), key=lambda leaf: (-death[leaf], leaf))
        rank = {leaf: place for place, leaf in enumerate(bars)}
        made = {len(death) + place: annexing for place, (_, annexing) in zip(self.graph.order, edges, strict=True)}
        return tuple(colour(rank[made[concept]]) for concept in concepts)

    def closeness(self, answer: Answer) -> tuple[float, ...]:
        """How close each listed concept is: from 1, the closest of the answer's time, to 0, its farthest or beyond."""
        own = answer.responses[: len(self.concepts.concepts)] or [0.0]
        near, far = min(own), max(own)
        shares = ((far - concept.response) / ((far - near) or 1.0) for concept in answer.concepts)
        return tuple(min(1.0, max(0.0, share)) for share in shares)


def called(concept: Concept | LearnedConcept) -> str:
    """What a concept is called: by the name that people gave it, which others may share, and by its number."""
    return f"{concept.name} ({concept.id})" if concept.name else f"concept {concept.id}"


def motif(fired: FiredVertex) -> str:
    """What a motif that fired is called: by the segments that fired it."""
    numbers = ", ".join(map(str, fired.segments))
    return f"segment{'s' * (len(fired.segments) > 1)} {numbers}, motif level {fired.level}"
