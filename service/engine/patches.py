"""Cloud -> atomic patches: normals that keep creases sharp, and supervoxels (Sec. Object Segment Extraction).

Patches follow Papon et al., "Voxel Cloud Connectivity Segmentation", CVPR 2013, on geometry alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from service.engine.cloud import VoxelCloud
from service.engine.neighbours import Neighbourhood, connected_parts, neighbourhood, touching
from service.engine.params import PatchParams

FLATTEST = 4.0  # power with which flat neighbourhoods outvote those that straddle a crease
FLOW = 64  # rings of voxels that a patch may grow by
NOISE_FLOOR = 3e-3  # surface variation that a noisy plane has
SLIVER = 0.01  # variance across, relative to the variance along, below which a neighbourhood fixes no plane
TIE = 1e-5  # two voxels are equally far from their mean: what is nearer by less, in seed distances, is no nearer


@dataclass(frozen=True)
class Patches:
    """The atomic patches of a cloud.

    Attributes:
        cloud: the voxels' points.
        normals: (M, 3) float64, unit length, towards the viewpoint.
        adjacent: which voxels touch.
        labels: (M,) int64: the patch of each voxel, 0 to `count` - 1.
        count: number of patches.
    """

    cloud: VoxelCloud
    normals: NDArray[np.float64]
    adjacent: Neighbourhood
    labels: NDArray[np.int64]
    count: int


def extract_patches(cloud: VoxelCloud, params: PatchParams) -> Patches:
    """Over-segments a cloud into atomic patches that do not cross creases."""
    normals = estimate_normals(cloud, max(params.normal_radius, 2 * cloud.size))
    adjacent = touching(cloud.cells)
    seed = max(params.seed, 3 * cloud.size)
    labels = _grow(
        cloud.points, normals, adjacent.indptr, adjacent.indices, _seeds(cloud.points, seed), seed,
        params.normal_weight, params.spatial_weight, params.iterations,
    )  # fmt: skip
    return Patches(cloud, normals, adjacent, labels, int(labels.max()) + 1)


def estimate_normals(cloud: VoxelCloud, radius: float) -> NDArray[np.float64]:
    """Unit normals towards the viewpoint, which stay sharp at creases.

    A plane is fitted about each voxel; then each voxel takes the mean of the planes about its neighbours, of which
    the flattest weigh most, so that beside a crease the fits that do not straddle it decide.

    Args:
        cloud: (M, 3) points, extents.
        radius: of the planes' support, extents.

    Returns:
        (M, 3) float64.
    """
    near = neighbourhood(cloud.points, radius)
    variance, axes = np.linalg.eigh(_covariances(cloud.points, near.indptr, near.indices))
    thin = variance[:, 1] <= SLIVER * variance[:, 2]
    normals = np.where(thin[:, None], _across(axes[:, :, 2], cloud), axes[:, :, 0])
    variation = variance[:, 0] / np.maximum(variance.sum(axis=1), 1e-12)
    weight = np.where(thin, 0.0, 1 / (variation + NOISE_FLOOR) ** FLATTEST)
    _face(normals, cloud)
    normals = _flattest_mean(normals, weight, near.indptr, near.indices)
    _face(normals, cloud)
    return normals


def _across(lines: NDArray[np.float64], cloud: VoxelCloud) -> NDArray[np.float64]:
    """Unit normals (M, 3) of points that lie on lines: those across the line that look most towards the viewpoint."""
    sight = cloud.frame.viewpoint - cloud.points
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    across = sight - np.einsum("ij,ij->i", sight, lines)[:, None] * lines
    length = np.linalg.norm(across, axis=1, keepdims=True)
    return np.where(length > 1e-9, across / np.maximum(length, 1e-9), sight)


def _face(normals: NDArray[np.float64], cloud: VoxelCloud) -> None:
    """Turns normals, in place, to the side from which the sensor looked."""
    away = np.einsum("ij,ij->i", normals, cloud.frame.viewpoint - cloud.points) < 0
    normals[away] *= -1


def _seeds(points: NDArray[np.float64], seed: float) -> NDArray[np.int64]:
    """In each occupied cell of the seed grid, the voxel nearest to the mean of the cell's voxels; ascending."""
    cells = np.floor(points / seed).astype(np.int64)
    _, owner = np.unique(cells, axis=0, return_inverse=True)
    owner = owner.reshape(-1)
    count = np.bincount(owner)
    mean = np.stack([np.bincount(owner, points[:, axis]) / count for axis in range(3)], axis=1)
    away = np.round(np.linalg.norm(points - mean[owner], axis=1) / seed / TIE)
    order = np.lexsort((away, owner))
    return np.sort(order[np.concatenate([[0], np.cumsum(count)[:-1]])])


@njit(cache=True, nogil=True)
def _covariances(
    points: NDArray[np.float64], indptr: NDArray[np.int64], indices: NDArray[np.int64]
) -> NDArray[np.float64]:
    out = np.zeros((len(points), 3, 3))
    mean, away = np.empty(3), np.empty(3)
    for i in range(len(points)):
        near = indices[indptr[i] : indptr[i + 1]]
        mean[:] = 0.0
        for k in near:
            for a in range(3):
                mean[a] += points[k, a]
        for a in range(3):
            mean[a] /= len(near)
        for k in near:
            for a in range(3):
                away[a] = points[k, a] - mean[a]
            for a in range(3):
                for b in range(a + 1):
                    out[i, a, b] += away[a] * away[b]
        for a in range(3):
            for b in range(a):
                out[i, b, a] = out[i, a, b]
    return out


@njit(cache=True, nogil=True)
def _flattest_mean(
    normals: NDArray[np.float64], weight: NDArray[np.float64], indptr: NDArray[np.int64], indices: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Weighted mean of the neighbours' normals, unit length; the voxel's own where none of them weighs anything."""
    out = np.zeros_like(normals)
    for i in range(len(normals)):
        for k in indices[indptr[i] : indptr[i + 1]]:
            for axis in range(3):
                out[i, axis] += weight[k] * normals[k, axis]
        length = np.sqrt(_dot(out[i], out[i]))
        out[i] = out[i] / length if length > 0 else normals[i]
    return out


@njit(cache=True, nogil=True)
def _grow(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    indptr: NDArray[np.int64],
    indices: NDArray[np.int64],
    seeds: NDArray[np.int64],
    seed: float,
    normal_weight: float,
    spatial_weight: float,
    iterations: int,
) -> NDArray[np.int64]:
    """Flow-constrained clustering: patches grow from their seeds through touching voxels, nearest patch first.

    D = w_n (1 - |n1.n2|) + w_s |dx| / seed (Papon et al. 2013, without colour). Islands that no seed reaches, and
    parts that another patch cut off, become patches of their own. Returns the label of each voxel (M,).
    """
    centres, directions = points[seeds].copy(), normals[seeds].copy()
    starts = seeds.copy()
    labels = np.full(len(points), -1, np.int64)
    distance = np.empty(len(points))
    for _ in range(iterations):
        _flow(
            points, normals, indptr, indices, starts, centres, directions, normal_weight, spatial_weight / seed, labels,
            distance,
        )  # fmt: skip
        _recentre(points, normals, labels, centres, directions)
        _restart(points, labels, centres, starts, TIE * seed**2)
    return connected_parts(labels, indptr, indices)


@njit(cache=True, nogil=True)
def _flow(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    indptr: NDArray[np.int64],
    indices: NDArray[np.int64],
    starts: NDArray[np.int64],
    centres: NDArray[np.float64],
    directions: NDArray[np.float64],
    normal_weight: float,
    spatial_weight: float,
    labels: NDArray[np.int64],
    distance: NDArray[np.float64],
) -> None:
    """Labels voxels (M,), in place, ring after ring from the starts; each ring asks those that the last one changed."""
    labels[:] = -1
    distance[:] = np.inf
    labels[starts] = np.arange(len(starts))
    distance[starts] = 0.0
    changed = np.zeros(len(points), np.bool_)
    changed[starts] = True
    front = np.sort(starts)
    for _ in range(FLOW):
        if len(front) == 0:
            break
        before = labels[front]
        changed[front] = False
        for f in range(len(front)):
            label = before[f]
            for i in indices[indptr[front[f]] : indptr[front[f] + 1]]:
                if label == labels[i]:
                    continue
                bend = 1.0 - abs(_dot(normals[i], directions[label]))
                d = normal_weight * bend + spatial_weight * np.sqrt(_squared(points[i], centres[label]))
                if d < distance[i]:
                    distance[i], labels[i], changed[i] = d, label, True
        front = np.flatnonzero(changed)


@njit(cache=True, nogil=True)
def _recentre(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    labels: NDArray[np.int64],
    centres: NDArray[np.float64],
    directions: NDArray[np.float64],
) -> None:
    """Moves centres (P, 3) and directions (P, 3), in place, to the means of their patches' voxels."""
    count = np.zeros(len(centres))
    centres[:] = 0.0
    directions[:] = 0.0
    for i in range(len(points)):
        if labels[i] >= 0:
            count[labels[i]] += 1
            for axis in range(3):
                centres[labels[i], axis] += points[i, axis]
                directions[labels[i], axis] += normals[i, axis]
    for label in range(len(centres)):
        centres[label] /= count[label]
        directions[label] /= max(np.sqrt(_dot(directions[label], directions[label])), 1e-12)


@njit(cache=True, nogil=True)
def _restart(
    points: NDArray[np.float64],
    labels: NDArray[np.int64],
    centres: NDArray[np.float64],
    starts: NDArray[np.int64],
    tie: float,
) -> None:
    """Sets each patch's start, in place, to its voxel nearest to the centre; of equally near ones the first."""
    nearest = np.full(len(starts), np.inf)
    for i in range(len(points)):
        label = labels[i]
        if label >= 0:
            d = _squared(points[i], centres[label])
            if d < nearest[label] - tie:
                nearest[label], starts[label] = d, i


@njit(nogil=True, inline="always")
def _dot(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(nogil=True, inline="always")
def _squared(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Squared distance."""
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2
