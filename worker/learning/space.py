"""The topological space X: a spanning tree of the stimuli vectors, and its heat (Sec. Topological Space Generation)."""

from __future__ import annotations

import os

import numpy as np
from joblib import effective_n_jobs
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import csr_array

from service.engine.divergence import sparse_jsd
from service.engine.space import TopologicalSpace
from worker.learning.boxes import boxes
from worker.learning.coarse import project
from worker.learning.spanning import Rows, spanning_tree

DIMENSIONS = 16  # by which pairs too far apart to matter are told


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
    edges, distance = _tree(rows)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    edges = edges[order]
    return TopologicalSpace(edges, distance[order], _geodesic_sums(edges, rows.shape[0]))


def _tree(rows: csr_array) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The tree's edges and lengths: that of all vectors that differ, and from each its equals.

    Equal vectors are apart by rounding at most, and equally far from all others. Where they are nearer to one another
    than to any, which only such as differ by rounding could prevent, their edges are therefore those of the tree; else
    it is built without this knowledge.
    """
    total = _totals(rows)
    threads = min(effective_n_jobs(), os.cpu_count() or 1)
    given = Rows(rows.indptr, _unsigned(rows.indices), rows.data, total)
    points = project(rows, total, DIMENSIONS, threads)
    equal = _equals(rows, points)
    if (equal != np.arange(len(equal))).any():
        edges, distance = _tree_of(np.unique(equal), given, rows.shape[1], points, threads)
        near = np.full(len(equal), np.inf)
        np.minimum.at(near, edges, distance[:, None])
        others = np.flatnonzero(equal != np.arange(len(equal)))
        apart = np.array([_exact(rows, total, int(equal[i]), int(i)) for i in others])
        if (apart < near[equal[others]]).all():
            twins = np.stack([equal[others], others], axis=1)
            return np.concatenate([edges, twins]), np.concatenate([distance, apart])
    return _tree_of(np.arange(len(equal)), given, rows.shape[1], points, threads)


def _tree_of(
    vertices: NDArray[np.int64], rows: Rows, dimensions: int, points: NDArray[np.float64], threads: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    found = boxes(points[vertices])
    return spanning_tree(rows, dimensions, found._replace(vertex=vertices[found.vertex]), threads)


def _equals(rows: csr_array, points: NDArray[np.float64]) -> NDArray[np.int64]:
    """For each vector (N,) the first that is equal to it; vectors of different coordinates are not."""
    _, first, group = np.unique(points, axis=0, return_index=True, return_inverse=True)
    equal = first[group.ravel()]
    for i in np.flatnonzero(equal != np.arange(len(equal))).tolist():
        a, b = (slice(rows.indptr[v], rows.indptr[v + 1]) for v in (i, equal[i]))
        same = np.array_equal(rows.indices[a], rows.indices[b]) and np.array_equal(rows.data[a], rows.data[b])
        equal[i] = equal[i] if same else i
    return np.asarray(equal, dtype=np.int64)


def _exact(rows: csr_array, total: NDArray[np.float64], i: int, j: int) -> float:
    """The JSD of vectors i and j."""
    dense, own = np.zeros(rows.shape[1]), slice(rows.indptr[i], rows.indptr[i + 1])
    dense[rows.indices[own]] = rows.data[own] / total[i]
    start, stop = int(rows.indptr[j]), int(rows.indptr[j + 1])
    return float(sparse_jsd(dense, own.stop > own.start, rows.indices, rows.data, start, stop, float(total[j])))


def _unsigned(indices: NDArray[np.integer]) -> NDArray[np.uint32]:
    """Indices that need no look at their sign: comparing two vectors takes a third less time."""
    return indices.view(np.uint32) if indices.dtype == np.int32 else indices.astype(np.uint32)


def _totals(rows: csr_array) -> NDArray[np.float64]:
    """What to divide rows by so that they sum to 1; 1 for a row of zeros."""
    ends = zip(rows.indptr[:-1].tolist(), rows.indptr[1:].tolist(), strict=True)
    total = np.array([rows.data[start:stop].astype(np.float64).sum() for start, stop in ends])
    return np.where(total > 0, total, 1.0)


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
