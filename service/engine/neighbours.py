"""Which points are near which: the one spatial search that the stages share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree


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
        size = len(self.indptr) - 1
        graph = csr_array((np.ones(len(self.indices), np.int8), self.indices, self.indptr), shape=(size, size))
        return connected_components(graph, directed=False)[1].astype(np.int64)


def neighbourhood(points: NDArray[np.float64], radius: float, norm: float = 2.0) -> Neighbourhood:
    """All points within a radius of each, itself included.

    Args:
        points: (M, D).
        radius: in the points' unit.
        norm: of the Minkowski metric; infinity for boxes.
    """
    pairs = cKDTree(points).query_pairs(radius, p=norm, output_type="ndarray")
    own = np.arange(len(points))
    rows = np.concatenate([pairs[:, 0], pairs[:, 1], own])
    columns = np.concatenate([pairs[:, 1], pairs[:, 0], own])
    order = np.argsort(rows * len(points) + columns)
    indptr = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=len(points)))])
    return Neighbourhood(indptr, columns[order])


def touching(cells: NDArray[np.int32]) -> Neighbourhood:
    """Voxels, given by their cells (M, 3), that share a face, an edge or a corner."""
    return neighbourhood(cells.astype(np.float64), 1.5, np.inf)
