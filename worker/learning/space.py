"""The topological space X: a spanning tree of the stimuli vectors, and its heat (Sec. Topological Space Generation)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import csr_array

from service.engine.divergence import sparse_jsd
from service.engine.space import TopologicalSpace
from worker.learning.coarse import at_least, coarsen

LEVELS = (4, 8)  # of the coarse dimensions, 16 and 256, that pairs too far apart to matter are told by
ROUNDING = 1e-9  # relative, of a lower bound
SMALLEST = 1e-12  # and absolute: distances are sums that cancel to about 1e-15


class _Rows(NamedTuple):
    """Stimuli vectors as the rows of a sparse matrix, and what to divide each by so that it sums to 1."""

    indptr: NDArray[np.integer]
    indices: NDArray[np.integer]
    data: NDArray[np.floating]
    total: NDArray[np.float64]


def build_space(stimuli: csr_array) -> TopologicalSpace:
    """The tree of smallest total JSD, and its heats.

    Of edges equally long the lexicographically smaller goes first, so that one input has one tree. A vector of zeros
    is as far as can be, ln 2, from every other, and 0 from another such.

    Args:
        stimuli: (N, V) sparse, non-negative, indices ascending in each row.
    """
    rows = csr_array(stimuli)
    if not rows.has_sorted_indices:
        rows = rows.sorted_indices()
    total = _totals(rows)
    near, nearer = (coarsen(rows, total, levels) for levels in LEVELS)
    edges, distance = _prim(_Rows(rows.indptr, rows.indices, rows.data, total), rows.shape[1], near, nearer)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    edges = edges[order]
    return TopologicalSpace(edges, distance[order], _geodesic_sums(edges, rows.shape[0]))


def _totals(rows: csr_array) -> NDArray[np.float64]:
    """What to divide rows by so that they sum to 1; 1 for a row of zeros."""
    ends = zip(rows.indptr[:-1].tolist(), rows.indptr[1:].tolist(), strict=True)
    total = np.array([rows.data[start:stop].astype(np.float64).sum() for start, stop in ends])
    return np.where(total > 0, total, 1.0)


@njit(cache=True, nogil=True)
def _prim(
    rows: _Rows, dimensions: int, near: NDArray[np.float64], nearer: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Prim's algorithm in O(N) memory; edges are compared by (distance, smaller vertex, larger vertex).

    Lazy: how far a vertex is from the tree is known by a lower bound alone until that bound is the smallest there is.
    The tree and its lengths are those that all distances give, bit for bit.
    """
    size = len(rows.total)
    edges = np.empty((size - 1, 2), np.int64)
    length = np.empty(size - 1, np.float64)
    outside = np.arange(1, size)  # the vertices that are not in the tree yet
    tree = np.zeros(size, np.int64)  # those that are, in their order
    best = np.full(size, np.inf)  # exact distance from the first `known` of the tree
    parent = np.zeros(size, np.int64)
    known = np.zeros(size, np.int64)
    least = np.full(size, np.inf)  # lower bound of the distance from the others of the tree
    dense, bounds = np.zeros(dimensions), np.empty(size)
    for step in range(size - 1):
        newest, left = tree[step], size - 1 - step
        for i in outside[:left]:
            least[i] = min(least[i], _below(near, newest, i))
        while True:
            nearest, doubtful = 0, 0  # places in `outside`
            for place in range(1, left):
                i, j = outside[place], outside[nearest]
                if best[i] < best[j] or (best[i] == best[j] and _before(parent[i], i, parent[j], j)):
                    nearest = place
                if least[i] < least[outside[doubtful]]:
                    doubtful = place
            i = outside[doubtful]
            if least[i] > best[outside[nearest]]:
                break
            best[i], parent[i] = _closest(
                i, tree[known[i] : step + 1], best[i], parent[i], rows, near, nearer, dense, bounds
            )
            known[i], least[i] = step + 1, np.inf
        added = outside[nearest]
        outside[nearest] = outside[left - 1]
        a, b = parent[added], added
        edges[step, 0], edges[step, 1], length[step] = min(a, b), max(a, b), best[added]
        tree[step + 1] = added
    return edges, length


@njit(cache=True, nogil=True)
def _closest(
    i: int,
    others: NDArray[np.int64],
    best: float,
    parent: int,
    rows: _Rows,
    near: NDArray[np.float64],
    nearer: NDArray[np.float64],
    dense: NDArray[np.float64],
    bounds: NDArray[np.float64],
) -> tuple[float, int]:
    """The distance of vertex i from the closest of others, and which that is, if it is closer than `parent`.

    `dense` is all zeros, before and after; `bounds` is room for as many numbers as there are others.
    """
    first = -1
    for k in range(len(others)):
        bounds[k] = _below(near, i, others[k])
        if bounds[k] <= best:
            bounds[k] = max(bounds[k], _below(nearer, i, others[k]))
            if bounds[k] <= best and (first < 0 or bounds[k] < bounds[first]):
                first = k
    if first < 0:
        return best, parent
    start, stop = rows.indptr[i], rows.indptr[i + 1]
    for k in range(start, stop):
        dense[rows.indices[k]] = rows.data[k] / rows.total[i]
    for turn in range(-1, len(others)):  # the most promising first: it spares most of the others
        k = first if turn < 0 else turn
        if bounds[k] <= best and (turn < 0 or k != first):
            j = others[k]
            d = _exact(dense, i, j, rows)
            if d < best or (d == best and _before(i, j, i, parent)):
                best, parent = d, j
    for k in range(start, stop):
        dense[rows.indices[k]] = 0.0
    return best, parent


@njit(cache=True, nogil=True)
def _exact(dense: NDArray[np.float64], i: int, j: int, rows: _Rows) -> float:
    """The JSD of vertices i, which lies in `dense`, and j."""
    start, stop = rows.indptr[j], rows.indptr[j + 1]
    filled = rows.indptr[i + 1] > rows.indptr[i]
    return sparse_jsd(dense, filled, rows.indices, rows.data, start, stop, rows.total[j])


@njit(cache=True, nogil=True)
def _below(coarse: NDArray[np.float64], i: int, j: int) -> float:
    """A lower bound of the distance that holds in spite of rounding."""
    return at_least(coarse, i, j) * (1 - ROUNDING) - SMALLEST


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
