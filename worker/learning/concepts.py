"""Extracting concepts from a filtration (Sec. Extraction of Persistent Shape Concepts)."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from service.engine.concepts import concepts_at
from service.engine.filtration import Filtration, annexations_over_time


class Extraction(NamedTuple):
    """A filtration whose epsilon_max gives concepts, and what the rule for degenerate outcomes had to say."""

    filtration: Filtration
    notes: tuple[str, ...]


def extract_concepts(filtration: Filtration) -> Extraction:
    """Sees to it that the concepts at epsilon_max, the components of F without its later edges, tell objects apart.

    Where most annexations come so late that a single concept holds every prototype, the time of most annexations
    among those with at least two concepts is taken instead, if there is one; a note says so.
    """
    times, counts = annexations_over_time(filtration)
    if len(times) == 1 or _tells_apart(filtration):
        return Extraction(filtration, ())
    most = filtration.epsilon_max
    for time in times[np.lexsort((times, -counts))].tolist():
        if len(concepts_at(filtration, time).sizes) >= 2:
            note = f"most annexations at time {most:g}, where one concept holds all: epsilon_max is {time:g} instead"
            return Extraction(replace(filtration, epsilon_max=time), (note,))
    return Extraction(filtration, (f"no filtration time has two concepts; epsilon_max is {most:g}",))


def _tells_apart(filtration: Filtration) -> bool:
    """Whether not all prototypes are in one concept."""
    sizes = concepts_at(filtration).sizes
    return len(sizes) != 1 or int(sizes[0]) < len(filtration.time) + 1
