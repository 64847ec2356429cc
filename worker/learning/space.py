"""The topological space X: a spanning tree of the stimuli vectors, and its heat (Sec. Topological Space Generation)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import csr_array

from service.engine.divergence import sparse_jsd
from service.engine.space import TopologicalSpace


def build_space(stimuli: csr_array) -> TopologicalSpace:
    """The tree of smallest total JSD, and its heats.

    Of edges equally long the lexicographically smaller goes first, so that one input has one tree. A vector of zeros
    is as far as can be, ln 2, from every other, and 0 from another such.

    Args:
        stimuli: (N, V) sparse, non-negative, indices ascending in each row.
    """
    rows = csr_array(stimuli.astype(np.float64))
    rows.sort_indices()
    edges, distance = _prim(
        rows.indptr.astype(np.int64), rows.indices.astype(np.int64), _normalised(rows), rows.shape[1]
    )
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    edges = edges[order]
    return TopologicalSpace(edges, distance[order], _geodesic_sums(edges, rows.shape[0]))


def _normalised(rows: csr_array) -> NDArray[np.float64]:
    """The data of rows that sum to 1."""
    total = np.array([row.sum() for row in np.split(rows.data, rows.indptr[1:-1])])
    return rows.data / np.repeat(np.where(total > 0, total, 1.0), np.diff(rows.indptr))


@njit(cache=True, nogil=True)
def _prim(
    indptr: NDArray[np.int64], indices: NDArray[np.int64], data: NDArray[np.float64], dimensions: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Prim's algorithm in O(N) memory; edges are compared by (distance, smaller vertex, larger vertex)."""
    size = len(indptr) - 1
    edges = np.empty((size - 1, 2), np.int64)
    length = np.empty(size - 1, np.float64)
    best = np.full(size, np.inf)
    parent = np.zeros(size, np.int64)
    outside = np.ones(size, np.bool_)
    dense = np.zeros(dimensions)
    newest = 0
    outside[0] = False
    for step in range(size - 1):
        for k in range(indptr[newest], indptr[newest + 1]):
            dense[indices[k]] = data[k]
        nearest = -1
        for i in range(size):
            if not outside[i]:
                continue
            d = sparse_jsd(dense, indptr[newest + 1] > indptr[newest], indices, data, indptr[i], indptr[i + 1])
            if d < best[i] or (d == best[i] and _before(newest, i, parent[i], i)):
                best[i], parent[i] = d, newest
            if (
                nearest < 0
                or best[i] < best[nearest]
                or (best[i] == best[nearest] and _before(parent[i], i, parent[nearest], nearest))
            ):
                nearest = i
        for k in range(indptr[newest], indptr[newest + 1]):
            dense[indices[k]] = 0.0
        a, b = parent[nearest], nearest
        edges[step, 0], edges[step, 1], length[step] = min(a, b), max(a, b), best[nearest]
        outside[nearest] = False
        newest = nearest
    return edges, length


@njit(cache=True, nogil=True)
def _before(a: int, b: int, c: int, d: int) -> bool:
    """Whether the edge a-b stands before c-d."""
    low, high = min(a, b), max(a, b)
    return low < min(c, d) or (low == min(c, d) and high < max(c, d))


@njit(cache=True, nogil=True)
def _geodesic_sums(edges: NDArray[np.int64], size: int) -> NDArray[np.int64]:
    """Sum of the distances from each vertex to all in a tree of unit edges, in two passes over the rooted tree.

    From the leaves: sizes of the subtrees. From the root: going down an edge brings the subtree's vertices one
    nearer, and takes all others one farther, so sum(child) = sum(parent) + size - 2 * subtree(child).
    """
    order, parent = _breadth_first(edges, size)
    subtree = np.ones(size, np.int64)
    sums = np.zeros(size, np.int64)
    for k in range(size - 1, 0, -1):
        subtree[parent[order[k]]] += subtree[order[k]]
        sums[0] += subtree[order[k]]
    for k in range(1, size):
        v = order[k]
        sums[v] = sums[parent[v]] + size - 2 * subtree[v]
    return sums


@njit(cache=True, nogil=True)
def _breadth_first(edges: NDArray[np.int64], size: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Vertices from vertex 0 outwards, and each one's parent."""
    start = np.zeros(size + 1, np.int64)
    for e in range(len(edges)):
        start[edges[e, 0] + 1] += 1
        start[edges[e, 1] + 1] += 1
    start = np.cumsum(start)
    fill = start[:-1].copy()
    near = np.empty(2 * len(edges), np.int64)
    for e in range(len(edges)):
        a, b = edges[e]
        near[fill[a]], near[fill[b]] = b, a
        fill[a] += 1
        fill[b] += 1
    order = np.zeros(size, np.int64)
    parent = np.full(size, -1, np.int64)
    end = 1
    for k in range(size):
        v = order[k]
        for w in near[start[v] : start[v + 1]]:
            if w != parent[v]:
                parent[w], order[end] = v, w
                end += 1
    return order, parent
