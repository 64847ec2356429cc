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


def merge_patches(patches: Patches, params: SegmentParams, near: Neighbourhood | None = None) -> SegmentGraph:
    """Merges patches across smooth borders, the smoothest first, and absorbs fragments into their neighbours.

    A border's bend is the mean angle between the normals on its two sides, less what the two patches bend in
    themselves: a thin cylinder bends everywhere, a crease only at the border. The bend of a merged segment is the mean
    over its whole border, so that one blurred spot does not weld the two sides of a crease.

    Args:
        patches: of one object.
        params: what is smooth, and what is small.
        near: what is around each voxel, within `BAND` voxels at least; None: it is looked for.
    """
    cloud = patches.cloud
    reach = BAND * cloud.size
    band = near.within(reach) if near else neighbourhood(cloud.points, reach, cloud.size)
    slack, length = _borders(patches, band)
    size = np.bincount(patches.labels, minlength=patches.count).astype(np.float64)
    least = params.min_share * len(cloud.points)
    merged = _merge(slack, length, size, -np.radians(params.angle), least, params.max_segments)
    labels = _by_size(merged[patches.labels])
    share = np.bincount(labels) / len(cloud.points)
    return SegmentGraph(
        points=cloud.points,
        normals=patches.normals,
        labels=labels,
        share=share,
        edges=_adjacent_segments(labels, len(share), band),
        voxel=cloud.size,
        frame=cloud.frame,
    )


def _borders(patches: Patches, near: Neighbourhood) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Summed slack, radians (P, P), and numbers of touching voxel pairs (P, P), of every two patches.

    The slack of a pair is what its patches bend in themselves less what the border bends: negative at a crease.
    """
    labels, touch = patches.labels, patches.adjacent
    sides = _side_normals(patches.normals, labels, near.indptr, near.indices)
    curved = np.minimum(_own_bend(patches.normals, labels, patches.count), MOST_CURVED)
    return _sum_borders(sides, labels, curved, touch.indptr, touch.indices)


@njit(cache=True, nogil=True, error_model="numpy")
def _sum_borders(
    sides: NDArray[np.float64],
    labels: NDArray[np.int64],
    curved: NDArray[np.float64],
    indptr: NDArray[np.int64],
    indices: NDArray[np.int32],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What `_borders` returns, from the normals on the sides of borders and the patches' own bends."""
    slack, length = np.zeros((len(curved), len(curved))), np.zeros((len(curved), len(curved)))
    for i in range(len(labels)):
        a = labels[i]
        for k in indices[indptr[i] : indptr[i + 1]]:
            b = labels[k]
            if a != b and i < k:
                pair = curved[a] + curved[b] - _angle(sides[i], sides[k])
                slack[a, b] += pair
                slack[b, a] += pair
                length[a, b] += 1
                length[b, a] += 1
    return slack, length


@njit(cache=True, nogil=True, error_model="numpy")
def _own_bend(normals: NDArray[np.float64], labels: NDArray[np.int64], count: int) -> NDArray[np.float64]:
    """Mean angle between the normals of a patch and their mean, radians (P,)."""
    mean, size, out = np.zeros((count, 3)), np.zeros(count), np.zeros(count)
    for i in range(len(labels)):
        size[labels[i]] += 1
        for axis in range(3):
            mean[labels[i], axis] += normals[i, axis]
    for p in range(count):
        mean[p] /= max(np.sqrt(mean[p, 0] ** 2 + mean[p, 1] ** 2 + mean[p, 2] ** 2), 1e-12)
    for i in range(len(labels)):
        out[labels[i]] += _angle(normals[i], mean[labels[i]])
    return out / size


@njit(cache=True, nogil=True, error_model="numpy")
def _angle(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Between unit vectors, radians."""
    return np.arccos(min(max(a[0] * b[0] + a[1] * b[1] + a[2] * b[2], -1.0), 1.0))


@njit(cache=True, nogil=True, error_model="numpy")
def _by_size(labels: NDArray[np.int64]) -> NDArray[np.int64]:
    """Renumbers labels by decreasing size; of equal sizes the one whose first point comes first."""
    size, seen = np.zeros(labels.max() + 1, np.int64), np.empty(labels.max() + 1, np.int64)
    count = 0
    for label in labels:
        if size[label] == 0:
            seen[count] = label
            count += 1
        size[label] += 1
    rank = np.empty(len(size), np.int64)
    order = np.argsort(-size[seen[:count]], kind="mergesort")
    for place in range(count):
        rank[seen[order[place]]] = place
    return rank[labels]


def _adjacent_segments(labels: NDArray[np.int64], count: int, near: Neighbourhood) -> NDArray[np.int64]:
    meeting = _meeting(labels, count, near.indptr, near.indices)
    return np.argwhere(np.triu(meeting, 1))


@njit(cache=True, nogil=True, error_model="numpy")
def _meeting(
    labels: NDArray[np.int64], count: int, indptr: NDArray[np.int64], indices: NDArray[np.int32]
) -> NDArray[np.bool_]:
    """Which segments have points near one another (S, S)."""
    out = np.zeros((count, count), np.bool_)
    for i in range(len(labels)):
        for k in indices[indptr[i] : indptr[i + 1]]:
            out[labels[i], labels[k]] = True
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _side_normals(
    normals: NDArray[np.float64], labels: NDArray[np.int64], indptr: NDArray[np.int64], indices: NDArray[np.int32]
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


@njit(cache=True, nogil=True, error_model="numpy")
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
    _merge_smooth(slack, length, size, root, smooth)
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
    return _roots(root)


@njit(cache=True, nogil=True, error_model="numpy")
def _merge_smooth(
    slack: NDArray[np.float64],
    length: NDArray[np.float64],
    size: NDArray[np.float64],
    root: NDArray[np.int64],
    smooth: float,
) -> None:
    """Joins, in place, the two regions of the smoothest border until none is smooth; of equal ones the last.

    The borders stand in a list with their mean slacks, of which those of the joined region alone change.
    """
    first, second = np.nonzero(np.tril(length))
    mean = np.empty(len(first))
    for p in range(len(first)):
        mean[p] = slack[first[p], second[p]] / length[first[p], second[p]]
    count = len(first)
    while count > 0:
        best = 0
        for p in range(1, count):
            if mean[p] > mean[best] or (mean[p] == mean[best] and (first[p], second[p]) > (first[best], second[best])):
                best = p
        if not mean[best] >= smooth:
            break
        b, a = first[best], second[best]
        kept = 0
        for p in range(count):
            other = second[p] if first[p] == b else first[p]
            if b in (first[p], second[p]):
                if other == a or length[a, other] > 0:
                    continue
                first[kept], second[kept] = max(a, other), min(a, other)
            else:
                first[kept], second[kept], mean[kept] = first[p], second[p], mean[p]
            kept += 1
        count = kept
        _join(a, b, slack, length, size, root)
        for p in range(count):
            if a in (first[p], second[p]):
                mean[p] = slack[first[p], second[p]] / length[first[p], second[p]]


@njit(cache=True, nogil=True, error_model="numpy")
def _join(
    a: int,
    b: int,
    slack: NDArray[np.float64],
    length: NDArray[np.float64],
    size: NDArray[np.float64],
    root: NDArray[np.int64],
) -> None:
    """Region b becomes part of region a."""
    for c in range(len(size)):
        if length[b, c] > 0:
            slack[a, c] += slack[b, c]
            length[a, c] += length[b, c]
            slack[c, a], length[c, a] = slack[a, c], length[a, c]
            slack[b, c], slack[c, b], length[b, c], length[c, b] = 0.0, 0.0, 0.0, 0.0
    slack[a, a], length[a, a] = 0.0, 0.0
    size[a] += size[b]
    size[b] = 0.0
    root[b] = a


@njit(cache=True, nogil=True, error_model="numpy")
def _roots(root: NDArray[np.int64]) -> NDArray[np.int64]:
    """The region that each one has become part of, through all that that one has become part of."""
    out = root.copy()
    for p in range(len(out)):
        while out[p] != root[out[p]]:
            out[p] = root[out[p]]
    return out
