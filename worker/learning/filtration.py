"""The filtration of the topological space: annexations over time, F and epsilon_max (Sec. Topological Filtration)."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from service.engine.concepts import concepts_at
from service.engine.filtration import Filtration, annexations_over_time
from service.engine.params import FiltrationParams
from service.engine.space import TopologicalSpace


class FiltrationResult(NamedTuple):
    """A filtration, and what the rule for degenerate outcomes had to say."""

    filtration: Filtration
    notes: tuple[str, ...]


def filtrate(space: TopologicalSpace, params: FiltrationParams) -> FiltrationResult:
    """Grows nested radii over the space and records which component annexes which, and when.

    The radii run from the smallest to the largest edge distance in steps of the smallest, or larger ones where more
    than `max_steps` would be needed. Components merge in the order of (distance, edge); the larger one sustains, of
    equal ones that with the smaller representative.
    """
    distance, time = _edge_distances(space.geodesic_sum, space.edges, params.max_steps)
    order = np.lexsort((space.edges[:, 1], space.edges[:, 0], distance))
    annexed, annexing = _annex(space.edges, order)
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    filtration = Filtration(distance, time, rank, annexed, annexing, epsilon_max=0.0)
    return _with_epsilon_max(filtration)


def _edge_distances(
    geodesic_sum: NDArray[np.int64], edges: NDArray[np.int64], max_steps: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Edge distances and annexation times (N - 1,).

    The mean of two vertex heats, scaled and inverted, is (2 max S - S_j - S_k) / (2 (max S - min S)) for the sums S
    of geodesic distances. The numerator is an integer, so that equal heats are equal and the grid's points exact.
    """
    heat = 2 * int(geodesic_sum.max()) - geodesic_sum[edges].sum(axis=1)
    scale = 2 * int(np.ptp(geodesic_sum))
    smallest, span = int(heat.min()), int(np.ptp(heat))
    if span == 0:
        time = np.zeros(len(heat))
    elif smallest * max_steps >= span:
        steps = -((smallest - heat) // smallest)  # the quotient, rounded up
        time = np.minimum(steps * smallest / span, 1.0)
    else:
        steps = -((smallest - heat) * max_steps // span)
        time = steps / max_steps
    return heat / scale if scale else np.zeros(len(heat)), time


@njit(cache=True, nogil=True)
def _annex(edges: NDArray[np.int64], order: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """For each edge, the representatives of the component that dies and of the one that sustains."""
    size = len(edges) + 1
    root = np.arange(size)
    weight = np.ones(size, np.int64)
    annexed = np.empty(len(edges), np.int64)
    annexing = np.empty(len(edges), np.int64)
    for e in order:
        a, b = edges[e]
        while root[a] != a:
            root[a] = root[root[a]]
            a = root[a]
        while root[b] != b:
            root[b] = root[root[b]]
            b = root[b]
        if weight[a] < weight[b] or (weight[a] == weight[b] and b < a):
            a, b = b, a
        root[b] = a
        weight[a] += weight[b]
        annexed[e], annexing[e] = b, a
    return annexed, annexing


def _with_epsilon_max(filtration: Filtration) -> FiltrationResult:
    """Sets epsilon_max: the time of most annexations, of tied ones the earliest.

    Where that is so late that a single concept holds every prototype, the time of most annexations among those with
    at least two concepts is taken instead, if there is one.
    """
    times, counts = annexations_over_time(filtration)
    by_count = times[np.lexsort((times, -counts))]
    most = float(by_count[0])
    if len(times) == 1 or _tells_apart(filtration, most):
        return FiltrationResult(replace(filtration, epsilon_max=most), ())
    for time in by_count[1:].tolist():
        if len(concepts_at(filtration, time).sizes) >= 2:
            note = f"most annexations at time {most:g}, where one concept holds all: epsilon_max is {time:g} instead"
            return FiltrationResult(replace(filtration, epsilon_max=time), (note,))
    note = f"no filtration time has two concepts; epsilon_max is {most:g}"
    return FiltrationResult(replace(filtration, epsilon_max=most), (note,))


def _tells_apart(filtration: Filtration, time: float) -> bool:
    """Whether not all prototypes are in one concept."""
    sizes = concepts_at(filtration, time).sizes
    return len(sizes) != 1 or int(sizes[0]) < len(filtration.time) + 1
