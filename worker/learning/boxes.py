"""Points in nested boxes: what is near is found without a look at what is far (a k-d tree)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

LEAF = 16  # points of a smallest box, at most


class Boxes(NamedTuple):
    """N points, halved across their longest side, and the halves again; box t holds the boxes 2 t + 1 and 2 t + 2.

    Attributes:
        vertex: (N,) int64: which point stands at each place; those of a box stand side by side.
        points: (N, k) by place.
        start: (T + 1,) int64: the first place of each box; the smallest boxes are the last.
        stop: (T,) int64: the place after its last.
        low: (T, k) the least coordinates of its points.
        high: (T, k) the largest.
    """

    vertex: NDArray[np.int64]
    points: NDArray[np.float64]
    start: NDArray[np.int64]
    stop: NDArray[np.int64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]


def boxes(points: NDArray[np.float64]) -> Boxes:
    """Boxes of points (N, k), N at least 1."""
    levels = max(int(np.ceil(np.log2(len(points) / LEAF))), 0)
    count = 2 ** (levels + 1) - 1
    low, high = np.empty((count, points.shape[1])), np.empty((count, points.shape[1]))
    vertex, start, stop = np.arange(len(points)), np.zeros(count, np.int64), np.zeros(count, np.int64)
    _halve(points, vertex, start, stop, low, high)
    return Boxes(vertex, points[vertex], start, stop, low, high)


@njit(cache=True, nogil=True)
def _halve(
    points: NDArray[np.float64],
    vertex: NDArray[np.int64],
    start: NDArray[np.int64],
    stop: NDArray[np.int64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
) -> None:
    stop[0] = len(vertex)
    for t in range(len(start)):
        own = vertex[start[t] : stop[t]]
        low[t], high[t] = points[own[0]], points[own[0]]
        for i in own:
            for k in range(points.shape[1]):
                low[t, k], high[t, k] = min(low[t, k], points[i, k]), max(high[t, k], points[i, k])
        if 2 * t + 2 < len(start):
            side = np.argmax(high[t] - low[t])
            vertex[start[t] : stop[t]] = own[np.argsort(points[own, side], kind="mergesort")]
            middle = (start[t] + stop[t]) // 2
            start[2 * t + 1], stop[2 * t + 1] = start[t], middle
            start[2 * t + 2], stop[2 * t + 2] = middle, stop[t]


@njit(cache=True, nogil=True)
def squared_from(low: NDArray[np.float64], high: NDArray[np.float64], t: int, point: NDArray[np.float64]) -> float:
    """Squared Euclidean distance of a point (k,) from box t, 0 inside."""
    squared = 0.0
    for k in range(len(point)):
        outside = max(low[t, k] - point[k], point[k] - high[t, k], 0.0)
        squared += outside * outside
    return squared


@njit(cache=True, nogil=True)
def of_one(component: NDArray[np.int64], start: NDArray[np.int64], stop: NDArray[np.int64]) -> NDArray[np.int64]:
    """The component of which all points of a box are (T,), -1 where they are of several."""
    out = np.empty(len(start), np.int64)
    for t in range(len(start) - 1, -1, -1):
        if 2 * t + 2 < len(start):
            out[t] = out[2 * t + 1] if out[2 * t + 1] == out[2 * t + 2] else -1
        else:
            own = component[start[t] : stop[t]]
            out[t] = own[0] if (own == own[0]).all() else -1
    return out
