"""Patches -> super patches ("segments") and their graph g^o (Sec. Object Segment Extraction)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from service.engine.cloud import Frame
from service.engine.neighbours import Neighbourhood, neighbourhood
from service.engine.params import SegmentParams
from service.engine.patches import Patches

BAND = 2.5  # voxels: the normals within speak for their side of a border, and returns may be missing between segments
MOST_CURVED = np.radians(15)  # a patch that bends more may straddle a crease


@dataclass(frozen=True)
class SegmentGraph:
    """The segments of an object and which of them are adjacent: g^o.

    Segments are numbered by decreasing size, so that the numbers mean the same for any order of the points.

    Attributes:
        points: (M, 3) float64, extents.
        normals: (M, 3) float64, unit length, towards the viewpoint.
        labels: (M,) int64: the segment of each point.
        share: (S,) float64: each segment's share of the surface seen.
        edges: (E, 2) int64: adjacent segments, the smaller number first, sorted.
        voxel: the distance of neighbouring points, extents.
        frame: where the points lie.
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    labels: NDArray[np.int64]
    share: NDArray[np.float64]
    edges: NDArray[np.int64]
    voxel: float
    frame: Frame

    @property
    def count(self) -> int:
        """Number of segments S."""
        return len(self.share)


def merge_patches(patches: Patches, params: SegmentParams) -> SegmentGraph:
    """Merges patches across smooth borders, the smoothest first, and absorbs fragments into their neighbours.

    A border's bend is the mean angle between the normals on its two sides, less what the two patches bend in
    themselves: a thin cylinder bends everywhere, a crease only at the border. The bend of a merged segment is the mean
    over its whole border, so that one blurred spot does not weld the two sides of a crease.
    """
    points = patches.cloud.points
    near = neighbourhood(points, BAND * patches.cloud.size)
    slack, length = _borders(patches, near)
    size = np.bincount(patches.labels, minlength=patches.count).astype(np.float64)
    least = params.min_share * len(points)
    merged = _merge(slack, length, size, -np.radians(params.angle), least, params.max_segments)
    labels = _by_size(merged[patches.labels])
    share = np.bincount(labels) / len(points)
    return SegmentGraph(
        points=points,
        normals=patches.normals,
        labels=labels,
        share=share,
        edges=_adjacent_segments(labels, len(share), near),
        voxel=patches.cloud.size,
        frame=patches.cloud.frame,
    )


def _borders(patches: Patches, near: Neighbourhood) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Summed slack, radians (P, P), and numbers of touching voxel pairs (P, P), of every two patches.

    The slack of a pair is what its patches bend in themselves less what the border bends: negative at a crease.
    """
    sides = _side_normals(patches.normals, patches.labels, near.indptr, near.indices)
    touch = patches.adjacent
    across = patches.labels[touch.rows] != patches.labels[touch.indices]
    a, b = touch.rows[across], touch.indices[across]
    bend = np.arccos(np.clip(np.einsum("ij,ij->i", sides[a], sides[b]), -1, 1))
    curved = np.minimum(_own_bend(patches), MOST_CURVED)
    slack = curved[patches.labels[a]] + curved[patches.labels[b]] - bend
    keys = patches.labels[a] * patches.count + patches.labels[b]
    shape = (patches.count, patches.count)
    slack_sum = np.bincount(keys, slack, minlength=patches.count**2).reshape(shape).astype(np.float64)
    length = np.bincount(keys, minlength=patches.count**2).reshape(shape).astype(np.float64)
    return slack_sum, length


def _own_bend(patches: Patches) -> NDArray[np.float64]:
    """Mean angle between the normals of a patch and their mean, radians (P,)."""
    sums = np.stack([np.bincount(patches.labels, axis) for axis in patches.normals.T], axis=1)
    mean = sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-12)
    cosine = np.einsum("ij,ij->i", patches.normals, mean[patches.labels])
    return np.bincount(patches.labels, np.arccos(np.clip(cosine, -1, 1))) / np.bincount(patches.labels)


def _by_size(labels: NDArray[np.int64]) -> NDArray[np.int64]:
    """Renumbers labels by decreasing size; of equal sizes the one whose first point comes first."""
    values, first, inverse, count = np.unique(labels, return_index=True, return_inverse=True, return_counts=True)
    rank = np.empty(len(values), np.int64)
    rank[np.lexsort((first, -count))] = np.arange(len(values))
    return rank[inverse]


def _adjacent_segments(labels: NDArray[np.int64], count: int, near: Neighbourhood) -> NDArray[np.int64]:
    meeting = _meeting(labels, count, near.indptr, near.indices)
    return np.argwhere(np.triu(meeting, 1))


@njit(cache=True, nogil=True)
def _meeting(
    labels: NDArray[np.int64], count: int, indptr: NDArray[np.int64], indices: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Which segments have points near one another (S, S)."""
    out = np.zeros((count, count), np.bool_)
    for i in range(len(labels)):
        for k in indices[indptr[i] : indptr[i + 1]]:
            out[labels[i], labels[k]] = True
    return out


@njit(cache=True, nogil=True)
def _side_normals(
    normals: NDArray[np.float64], labels: NDArray[np.int64], indptr: NDArray[np.int64], indices: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Mean normal of the nearby points of the same patch (M, 3), unit length."""
    out = np.zeros_like(normals)
    for i in range(len(normals)):
        for k in indices[indptr[i] : indptr[i + 1]]:
            if labels[k] == labels[i]:
                for axis in range(3):
                    out[i, axis] += normals[k, axis]
        length = max(np.sqrt(out[i, 0] ** 2 + out[i, 1] ** 2 + out[i, 2] ** 2), 1e-12)
        for axis in range(3):
            out[i, axis] /= length
    return out


@njit(cache=True, nogil=True)
def _merge(
    slack: NDArray[np.float64],
    length: NDArray[np.float64],
    size: NDArray[np.float64],
    smooth: float,
    least: float,
    most: int,
) -> NDArray[np.int64]:
    """The segment of each patch (P,).

    First the two regions with the smoothest border are joined while its mean slack is at least `smooth`; then the
    smallest region joins its smoothest neighbour while it is under `least` or there are more than `most`.
    A region without neighbours is left alone, unless there are too many: then it joins the largest.
    """
    slack, length, size = slack.copy(), length.copy(), size.copy()
    count = len(size)
    root = np.arange(count)
    while True:
        best, a, b = smooth, -1, -1
        for i in range(count):
            for j in range(i):
                if length[i, j] > 0 and slack[i, j] >= best * length[i, j]:
                    best, a, b = slack[i, j] / length[i, j], j, i
        if a < 0:
            break
        _join(a, b, slack, length, size, root)
    while True:
        alive = 0
        for i in range(count):
            alive += size[i] > 0
        a, b = -1, -1
        for i in np.argsort(size, kind="mergesort"):
            if size[i] > 0 and a < 0 and (size[i] < least or alive > most):
                best = -np.inf
                for j in range(count):
                    if size[j] > 0 and length[i, j] > 0 and slack[i, j] > best * length[i, j]:
                        best, a, b = slack[i, j] / length[i, j], j, i
        if a < 0 and alive > most:
            order = np.argsort(-size, kind="mergesort")
            a, b = order[0], order[alive - 1]
        if a < 0:
            break
        _join(a, b, slack, length, size, root)
    return root


@njit(cache=True, nogil=True)
def _join(
    a: int,
    b: int,
    slack: NDArray[np.float64],
    length: NDArray[np.float64],
    size: NDArray[np.float64],
    root: NDArray[np.int64],
) -> None:
    """Region b becomes part of region a."""
    slack[a] += slack[b]
    slack[:, a] += slack[:, b]
    length[a] += length[b]
    length[:, a] += length[:, b]
    slack[b], slack[:, b], length[b], length[:, b] = 0.0, 0.0, 0.0, 0.0
    slack[a, a], length[a, a] = 0.0, 0.0
    size[a] += size[b]
    size[b] = 0.0
    root[root == b] = a
