"""Which points are near which: the one spatial search that the stages share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

MOST_COLUMNS = 256  # of the search grid, along each of its two sides
CORNER = 1.8  # cells: beyond those that share a corner, short of the next but one
ROOM = 64  # neighbours of a point for which there is room beforehand
ROUNDING = 1e-3  # of the radius, by which columns are looked for farther: a point may lie on the side of one


@dataclass(frozen=True)
class Neighbourhood:
    """The points around each point within a radius, itself included, as compressed rows.

    Attributes:
        indptr: (M + 1,) int64: row i is `indices[indptr[i]:indptr[i + 1]]`.
        indices: (K,) int32, ascending in each row.
        squared: (K,) float64: squared distances.
        radius: of the neighbourhoods.
    """

    indptr: NDArray[np.int64]
    indices: NDArray[np.int32]
    squared: NDArray[np.float64]
    radius: float

    @property
    def rows(self) -> NDArray[np.int64]:
        """The row of each entry of `indices` (K,)."""
        return np.repeat(np.arange(len(self.indptr) - 1), np.diff(self.indptr))

    def within(self, radius: float) -> Neighbourhood:
        """Those of a radius that is no larger."""
        if radius == self.radius:
            return self
        return Neighbourhood(*_within(self.indptr, self.indices, self.squared, radius**2), radius)

    def islands(self) -> NDArray[np.int64]:
        """The connected component of each point (M,)."""
        return connected_parts(np.zeros(len(self.indptr) - 1, np.int64), self.indptr, self.indices)


def neighbourhood(points: NDArray[np.float64], radius: float, edge: float | None = None) -> Neighbourhood:
    """All points within a radius of each, itself included.

    They are looked up in columns along the last axis. Points that come column after column, as voxels do, are spared
    the sorting.

    Args:
        points: (M, 3).
        radius: in the points' unit.
        edge: of a column; for voxels that of the voxels. None: a third of the radius.
    """
    across = np.ascontiguousarray(points.T)
    low, high = across[:2].min(axis=1), across[:2].max(axis=1)
    edge = max(edge or radius / 3, float((high - low).max()) / MOST_COLUMNS, 1e-300)
    first = np.floor(low / edge)
    columns, starts, shape = _columns(across, first, np.floor(high / edge), edge)
    if (columns[1:] >= columns[:-1]).all():
        return Neighbourhood(*_near(across, starts, shape, first, edge, radius), radius)
    order = np.argsort(columns, kind="stable")
    rows = _near(np.ascontiguousarray(across[:, order]), starts, shape, first, edge, radius)
    return Neighbourhood(*_renamed(*rows, order), radius)


def touching(cells: NDArray[np.int32]) -> Neighbourhood:
    """Voxels, given by their cells (M, 3), that share a face, an edge or a corner."""
    return neighbourhood(cells.astype(np.float64), CORNER, 1.0)


@njit(cache=True, nogil=True, error_model="numpy")
def _columns(
    points: NDArray[np.float64], first: NDArray[np.float64], last: NDArray[np.float64], edge: float
) -> tuple[NDArray[np.int32], NDArray[np.int64], tuple[int, int]]:
    """The column of each of the points (3, M), where each begins in their order by columns, and how many there are."""
    shape = (int(last[0] - first[0]) + 1, int(last[1] - first[1]) + 1)
    columns = np.empty(points.shape[1], np.int32)
    starts = np.zeros(shape[0] * shape[1] + 1, np.int64)
    for i in range(points.shape[1]):
        x, y = np.floor(points[0, i] / edge) - first[0], np.floor(points[1, i] / edge) - first[1]
        columns[i] = int(x) * shape[1] + int(y)
        starts[columns[i] + 1] += 1
    for c in range(1, len(starts)):
        starts[c] += starts[c - 1]
    return columns, starts, shape


@njit(cache=True, nogil=True, error_model="numpy")
def _near(
    points: NDArray[np.float64],
    starts: NDArray[np.int64],
    shape: tuple[int, int],
    first: NDArray[np.float64],
    edge: float,
    radius: float,
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float64]]:
    """The rows of a `Neighbourhood` of points (3, M) that come column after column.

    Each pair is looked for once, from its first point; in the row of the second it stands before what that one found.
    """
    ends, found, away = _later(points, starts, shape, first, edge, radius)
    size = len(ends)
    indptr, filled = np.zeros(size + 1, np.int64), np.zeros(size, np.int64)
    for k in found:
        filled[k] += 1
    for i in range(size):
        count = ends[i] - (ends[i - 1] if i else 0)
        indptr[i + 1] = indptr[i] + filled[i] + 1 + count
        filled[i] = indptr[i]
    indices, squared = np.empty(indptr[-1], np.int32), np.empty(indptr[-1])
    for i in range(size):
        own = filled[i]  # after what earlier points found
        indices[own], squared[own] = i, 0.0
        for k in range(ends[i - 1] if i else 0, ends[i]):
            own += 1
            later = np.uint64(found[k])
            before = np.uint64(filled[later])
            filled[later] += 1
            indices[np.uint64(own)], squared[np.uint64(own)] = found[k], away[k]
            indices[before], squared[before] = i, away[k]
    return indptr, indices, squared


@njit(cache=True, nogil=True, error_model="numpy")
def _later(
    points: NDArray[np.float64],
    starts: NDArray[np.int64],
    shape: tuple[int, int],
    first: NDArray[np.float64],
    edge: float,
    radius: float,
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float64]]:
    """Of each point the later ones within the radius: where they end (M,), which they are, how far."""
    size = points.shape[1]
    found, squared = np.empty(ROOM * size, np.int32), np.empty(ROOM * size)
    ends = np.empty(size, np.int64)
    reach, margin, per_edge, end = radius**2, ROUNDING * radius, 1 / edge, 0
    xs, ys, zs = points
    for i in range(size):
        if len(found) < end + size:
            found, squared = _longer(found, end + ROOM * size), _longer(squared, end + ROOM * size)
        x, y, z = xs[i], ys[i], zs[i]
        own, _ = _reached(x, margin, per_edge, first[0], shape[0])
        _, right = _reached(x, radius + margin, per_edge, first[0], shape[0])
        for a in range(own, right + 1):
            gap = max((a + first[0]) * edge - x, 0.0)
            low, high = _reached(y, np.sqrt(max(reach - gap * gap, 0.0)) + margin, per_edge, first[1], shape[1])
            for k in range(max(starts[a * shape[1] + low], i + 1), starts[a * shape[1] + high + 1]):
                place, after = np.uint64(k), np.uint64(end)  # unsigned: no place counts from the end
                dx, dy, dz = xs[place] - x, ys[place] - y, zs[place] - z
                away = dx * dx + dy * dy + dz * dz
                found[after], squared[after] = k, away
                end += away <= reach
        ends[i] = end
    return ends, found[:end], squared[:end]


@njit(nogil=True, error_model="numpy", inline="always")
def _reached(at: float, reach: float, per_edge: float, first: float, count: int) -> tuple[int, int]:
    """The first and the last of a grid's columns that are within reach."""
    low = int(np.floor((at - reach) * per_edge) - first)
    high = int(np.floor((at + reach) * per_edge) - first)
    return max(low, 0), min(high, count - 1)


@njit(cache=True, nogil=True, error_model="numpy")
def _longer(old: NDArray[np.generic], size: int) -> NDArray[np.generic]:
    out = np.empty(size, old.dtype)
    out[: len(old)] = old
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _within(
    indptr: NDArray[np.int64], indices: NDArray[np.int32], squared: NDArray[np.float64], reach: float
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float64]]:
    """The entries of which the squared distance is within reach."""
    rows, found, away = np.zeros_like(indptr), np.empty_like(indices), np.empty_like(squared)
    end = 0
    for i in range(len(indptr) - 1):
        for k in range(indptr[i], indptr[i + 1]):
            found[end], away[end] = indices[k], squared[k]
            end += squared[k] <= reach
        rows[i + 1] = end
    return rows, found[:end], away[:end]


@njit(cache=True, nogil=True, error_model="numpy")
def _renamed(
    indptr: NDArray[np.int64], indices: NDArray[np.int32], squared: NDArray[np.float64], order: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float64]]:
    """The rows of sorted points as those of points in their own order: point k of the sorted ones is `order[k]`.

    Points enter one another's rows in ascending order, which so need no sorting.
    """
    size = len(order)
    rows, place = np.zeros(size + 1, np.int64), np.empty(size, np.int64)
    for k in range(size):
        rows[order[k] + 1] = indptr[k + 1] - indptr[k]
        place[order[k]] = k
    for i in range(size):
        rows[i + 1] += rows[i]
    filled, found, away = rows[:-1].copy(), np.empty_like(indices), np.empty_like(squared)
    for i in range(size):
        for k in range(indptr[place[i]], indptr[place[i] + 1]):
            other = order[indices[k]]
            found[filled[other]], away[filled[other]] = i, squared[k]
            filled[other] += 1
    return rows, found, away


@njit(cache=True, nogil=True, error_model="numpy")
def connected_parts(
    labels: NDArray[np.int64], indptr: NDArray[np.int64], indices: NDArray[np.int32]
) -> NDArray[np.int64]:
    """Gives every connected part of the points that bear one label a number of its own, counted from 0."""
    out = np.full(len(labels), -1, np.int64)
    stack = np.empty(len(labels), np.int64)
    count = 0
    for i in range(len(labels)):
        if out[i] >= 0:
            continue
        out[i], stack[0], top = count, i, 1
        while top > 0:
            top -= 1
            v = stack[top]
            for k in indices[indptr[v] : indptr[v + 1]]:
                if out[k] < 0 and labels[k] == labels[i]:
                    out[k], stack[top] = count, k
                    top += 1
        count += 1
    return out
