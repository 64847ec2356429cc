"""The filtration's outcome: the annexation graph F, the barcode of H_0, annexations over time.

Sec. Topological Filtration. The worker computes it; a model holds it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Filtration:
    """The filtration of the topological space, and its annexation graph F.

    The rows belong to the edges of the tree in lexicographic order. F has an edge from `annexed` to `annexing` with
    the annexation `time`. All components are born at 0, so the barcode of H_0 is the sorted times, and one bar that
    never ends.

    Attributes:
        distance: (N - 1,) float64: heat of the edge, from vertex heats scaled to [0, 1] and inverted.
        time: (N - 1,) float64: annexation time in [0, 1], on the grid of the filtration's steps.
        order: (N - 1,) int64: the place of the annexation among all, earliest first.
        annexed: (N - 1,) int64: the representative of the component that dies: the smaller one.
        annexing: (N - 1,) int64: the representative of the component that sustains.
        epsilon_max: the middle of the stretch of time of most annexations, at which concepts are taken.
    """

    distance: NDArray[np.float64]
    time: NDArray[np.float64]
    order: NDArray[np.int64]
    annexed: NDArray[np.int64]
    annexing: NDArray[np.int64]
    epsilon_max: float


def annexations_over_time(filtration: Filtration) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The times at which something is annexed, ascending, and how many annexations each saw."""
    times, counts = np.unique(filtration.time, return_counts=True)
    return times, counts.astype(np.int64)


def barcode(filtration: Filtration) -> NDArray[np.float64]:
    """The bars of H_0 (N, 2): births are 0; deaths the sorted annexation times, the last one infinite."""
    deaths = np.append(np.sort(filtration.time), np.inf)
    return np.stack([np.zeros(len(deaths)), deaths], axis=1)


def time_step(distance: NDArray[np.float64], max_steps: int) -> float:
    """The step of the filtration times: the smallest edge distance, or larger, over the span of the distances.

    Args:
        distance: (N - 1,) of all edges.
        max_steps: upper bound on the number of steps.
    """
    span = float(np.ptp(distance))
    return max(float(distance.min()) / span, 1 / max_steps) if span > 0 else 1.0
