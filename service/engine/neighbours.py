"""Which points are near which: the one spatial search that the stages share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

MOST_CELLS = 64  # of the search grid, along its longest side


@dataclass(frozen=True)
class Neighbourhood:
    """The points around each point within a radius, itself included, as compressed rows.

    Attributes:
        indptr: (M + 1,) int64: row i is `indices[indptr[i]:indptr[i + 1]]`.
        indices: (K,) int64, ascending in each row.
    """

    indptr: NDArray[np.int64]
    indices: NDArray[np.int64]

    @property
    def rows(self) -> NDArray[np.int64]:
        """The row of each entry of `indices` (K,)."""
        return np.repeat(np.arange(len(self.indptr) - 1), np.diff(self.indptr))

    def islands(self) -> NDArray[np.int64]:
        """The connected component of each point (M,)."""
        return connected_parts(np.zeros(len(self.indptr) - 1, np.int64), self.indptr, self.indices)


def neighbourhood(points: NDArray[np.float64], radius: float, norm: float = 2.0) -> Neighbourhood:
    """All points within a radius of each, itself included.

    Args:
        points: (M, 3).
        radius: in the points' unit.
        norm: of the Minkowski metric: 2, or infinity for boxes.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    edge = max(radius, (high - low).max() / MOST_CELLS)
    starts, order, cells, shape = _sorted_into_cells(points, low, edge)
    reach = radius if np.isinf(norm) else radius**2
    indptr, indices = _near(points, starts, order, cells, shape, reach, np.isinf(norm))
    return Neighbourhood(indptr, indices)


def touching(cells: NDArray[np.int32]) -> Neighbourhood:
    """Voxels, given by their cells (M, 3), that share a face, an edge or a corner."""
    return neighbourhood(cells.astype(np.float64), 1.5, np.inf)


@njit(cache=True, nogil=True)
def _sorted_into_cells(
    points: NDArray[np.float64], low: NDArray[np.float64], edge: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Where each cell of a grid begins in the points' order by cells, that order, the points' cells, and the shape.

    The grid has an empty layer around the points, so that every occupied cell has all its neighbours.
    """
    cells = np.empty(points.shape, np.int64)
    shape = np.zeros(3, np.int64)
    for i in range(len(points)):
        for axis in range(3):
            cells[i, axis] = int((points[i, axis] - low[axis]) / edge) + 1
            shape[axis] = max(shape[axis], cells[i, axis] + 2)
    starts = np.zeros(shape[0] * shape[1] * shape[2] + 1, np.int64)
    for i in range(len(points)):
        starts[(cells[i, 0] * shape[1] + cells[i, 1]) * shape[2] + cells[i, 2] + 1] += 1
    for c in range(1, len(starts)):
        starts[c] += starts[c - 1]
    filled = starts[:-1].copy()
    order = np.empty(len(points), np.int64)
    for i in range(len(points)):
        cell = (cells[i, 0] * shape[1] + cells[i, 1]) * shape[2] + cells[i, 2]
        order[filled[cell]] = i
        filled[cell] += 1
    return starts, order, cells, shape


@njit(cache=True, nogil=True)
def _near(
    points: NDArray[np.float64],
    starts: NDArray[np.int64],
    order: NDArray[np.int64],
    cells: NDArray[np.int64],
    shape: NDArray[np.int64],
    reach: float,
    boxes: bool,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The rows of a `Neighbourhood`. Points enter one another's rows in ascending order, which so need no sorting."""
    size = len(points)
    sorted_points = points[order]
    found = np.empty(64 * size, np.int64)
    ends = np.zeros(size + 1, np.int64)
    end = 0
    for i in range(size):
        if len(found) < end + size:
            found = np.concatenate((found, np.empty(len(found) + size, np.int64)))
        end = _row(points[i], sorted_points, starts, cells[i], shape, reach, boxes, found, end)
        ends[i + 1] = end
    indptr = np.zeros(size + 1, np.int64)
    for k in range(end):
        found[k] = order[found[k]]
        indptr[found[k] + 1] += 1
    for i in range(size):
        indptr[i + 1] += indptr[i]
    filled = indptr[:-1].copy()
    indices = np.empty(end, np.int64)
    for i in range(size):
        for k in range(ends[i], ends[i + 1]):
            indices[filled[found[k]]] = i
            filled[found[k]] += 1
    return indptr, indices


@njit(cache=True, nogil=True)
def _row(
    point: NDArray[np.float64],
    points: NDArray[np.float64],
    starts: NDArray[np.int64],
    cell: NDArray[np.int64],
    shape: NDArray[np.int64],
    reach: float,
    boxes: bool,
    found: NDArray[np.int64],
    end: int,
) -> int:
    """Appends the places of the points near one; returns the new end. Nothing branches on what is near."""
    x, y, z = point
    for a in range(cell[0] - 1, cell[0] + 2):
        for b in range(cell[1] - 1, cell[1] + 2):
            first = (a * shape[1] + b) * shape[2] + cell[2] - 1
            for k in range(starts[first], starts[first + 3]):
                dx, dy, dz = points[k, 0] - x, points[k, 1] - y, points[k, 2] - z
                away = max(abs(dx), abs(dy), abs(dz)) if boxes else dx * dx + dy * dy + dz * dz
                found[end] = k
                end += away <= reach
    return end


@njit(cache=True, nogil=True)
def connected_parts(
    labels: NDArray[np.int64], indptr: NDArray[np.int64], indices: NDArray[np.int64]
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
