"""The filtration of the topological space: annexations over time, F and epsilon_max (Sec. Topological Filtration)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from service.engine.filtration import Filtration, annexations_over_time
from service.engine.params import FiltrationParams
from service.engine.space import TopologicalSpace

MIDDLES = 100  # stretches of time that are tried, beside the first
NEGLIGIBLE = 1e-9  # times that differ by less are the same


def filtrate(space: TopologicalSpace, params: FiltrationParams) -> Filtration:
    """Grows nested radii over the space and records which component annexes which, and when.

    The radii run from the smallest to the largest edge distance in steps of the smallest, or larger ones where more
    than `max_steps` would be needed. Components merge in the order of (distance, edge); the larger one sustains, of
    equal ones that with the smaller representative. epsilon_max is the time of most annexations, counted over
    stretches of `window`, of tied ones the earliest.
    """
    distance, time = _edge_distances(space.geodesic_sum, space.edges, params.max_steps)
    order = np.lexsort((space.edges[:, 1], space.edges[:, 0], distance))
    annexed, annexing = _annex(space.edges, order)
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    filtration = Filtration(distance, time, rank, annexed, annexing, epsilon_max=0.0)
    return replace(filtration, epsilon_max=_busiest(filtration, params.window))


def _busiest(filtration: Filtration, window: float) -> float:
    """The middle of the stretch of time of length `window` that sees most annexations, of several the earliest.

    Counts of single steps are few and jump from model to model; a stretch's do not. It lies within [0, 1], so the end
    of time, where the last annexations crowd and one concept holds everything, is never its middle. Of a stretch of
    length 0, or where all times are equal, it is the step of most annexations.
    """
    times, counts = annexations_over_time(filtration)
    if window == 0 or len(times) == 1:
        return float(times[counts.argmax()])
    middles = np.linspace(window / 2, 1 - window / 2, MIDDLES + 1)
    before = np.concatenate([[0], np.cumsum(counts)])
    first = np.searchsorted(times, middles - window / 2 - NEGLIGIBLE)
    last = np.searchsorted(times, middles + window / 2 + NEGLIGIBLE)
    return float(middles[np.argmax(before[last] - before[first])])


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
