"""Cloud -> atomic patches: normals that keep creases sharp, and supervoxels (Sec. Object Segment Extraction).

Patches follow Papon et al., "Voxel Cloud Connectivity Segmentation", CVPR 2013, on geometry alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from service.engine.cloud import VoxelCloud
from service.engine.eigen import Vector, principal_axes
from service.engine.grid import means_of, occupied_cells
from service.engine.neighbours import Neighbourhood, connected_parts, neighbourhood
from service.engine.params import PatchParams

FLATTEST = 4  # power with which flat neighbourhoods outvote those that straddle a crease
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
        labels: (M,) int64: the patch of each voxel, 0 to `count` - 1.
        count: number of patches.
    """

    cloud: VoxelCloud
    normals: NDArray[np.float64]
    labels: NDArray[np.int64]
    count: int

    @property
    def adjacent(self) -> Neighbourhood:
        """Which voxels touch."""
        return self.cloud.adjacent


def extract_patches(cloud: VoxelCloud, params: PatchParams, near: Neighbourhood | None = None) -> Patches:
    """Over-segments a cloud into atomic patches that do not cross creases.

    Args:
        cloud: the voxels.
        params: radius of normals, distance of seeds and weights.
        near: what is around each voxel, within the radius of normals at least; None: it is looked for.
    """
    normals = estimate_normals(cloud, normal_radius(cloud, params), near)
    adjacent = cloud.adjacent
    seed = max(params.seed, 3 * cloud.size)
    labels = _grow(
        cloud.points, normals, adjacent.indptr, adjacent.indices, _seeds(cloud.points, seed), seed,
        params.normal_weight, params.spatial_weight, params.iterations,
    )  # fmt: skip
    return Patches(cloud, normals, labels, int(labels.max()) + 1)


def normal_radius(cloud: VoxelCloud, params: PatchParams) -> float:
    """Of the neighbourhood in which normals are estimated, extents."""
    return max(params.normal_radius, 2 * cloud.size)


def estimate_normals(cloud: VoxelCloud, radius: float, near: Neighbourhood | None = None) -> NDArray[np.float64]:
    """Unit normals towards the viewpoint, which stay sharp at creases.

    A plane is fitted about each voxel; then each voxel takes the mean of the planes about its neighbours, of which
    the flattest weigh most, so that beside a crease the fits that do not straddle it decide.

    Args:
        cloud: (M, 3) points, extents.
        radius: of the planes' support, extents.
        near: what is around each voxel, within the radius at least; None: it is looked for.

    Returns:
        (M, 3) float64.
    """
    support = near.within(radius) if near else neighbourhood(cloud.points, radius, cloud.size)
    viewpoint = cloud.frame.viewpoint
    planes, weight = _planes(cloud.points, support.indptr, support.indices, viewpoint)
    return _flattest_mean(cloud.points, planes, weight, support.indptr, support.indices, viewpoint)


def _seeds(points: NDArray[np.float64], seed: float) -> NDArray[np.int64]:
    """In each occupied cell of the seed grid, the voxel nearest to the mean of the cell's voxels; ascending."""
    across = np.ascontiguousarray(points.T)
    cell, keys, _ = occupied_cells(across, seed)
    return np.sort(_nearest_to(points, cell, means_of(across, cell, len(keys)), seed * TIE))


@njit(cache=True, nogil=True, error_model="numpy")
def _nearest_to(
    points: NDArray[np.float64], cell: NDArray[np.int32], means: NDArray[np.float64], step: float
) -> NDArray[np.int64]:
    """The voxel of each cell that is nearest to the cell's mean, in whole steps; of equally near ones the first."""
    nearest, out = np.full(len(means), np.inf), np.zeros(len(means), np.int64)
    for i in range(len(points)):
        away = np.rint(np.sqrt(_squared(points[i], means[cell[i]])) / step)
        if away < nearest[cell[i]]:
            nearest[cell[i]], out[cell[i]] = away, i
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _planes(
    points: NDArray[np.float64], indptr: NDArray[np.int64], indices: NDArray[np.int32], viewpoint: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit normals (M, 3) of the planes about each point, towards the viewpoint, and how much each is worth (M,).

    Points on a line fix no plane: theirs is the one that looks most towards the viewpoint, and is worth nothing.
    """
    normals, weight = np.empty_like(points), np.empty(len(points))
    for i in range(len(points)):
        x, y, z = points[i]
        sx, sy, sz, xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for place in range(indptr[i], indptr[i + 1]):
            k = np.uint64(indices[place])
            dx, dy, dz = points[k, 0] - x, points[k, 1] - y, points[k, 2] - z
            sx, sy, sz = sx + dx, sy + dy, sz + dz
            xx, xy, xz = xx + dx * dx, xy + dx * dy, xz + dx * dz
            yy, yz, zz = yy + dy * dy, yz + dy * dz, zz + dz * dz
        n = indptr[i + 1] - indptr[i]
        covariance = (
            xx - sx * sx / n, xy - sx * sy / n, xz - sx * sz / n, yy - sy * sy / n, yz - sy * sz / n, zz - sz * sz / n,
        )  # fmt: skip
        variance, flat, along = principal_axes(covariance)
        sight = (viewpoint[0] - x, viewpoint[1] - y, viewpoint[2] - z)
        if variance[1] <= SLIVER * variance[2]:
            flat, weight[i] = _across(along, sight), 0.0
        else:
            variation = max(variance[0], 0.0) / max(variance[0] + variance[1] + variance[2], 1e-300)
            weight[i] = 1 / (variation + NOISE_FLOOR) ** FLATTEST
        side = -1.0 if flat[0] * sight[0] + flat[1] * sight[1] + flat[2] * sight[2] < 0 else 1.0
        normals[i, 0], normals[i, 1], normals[i, 2] = side * flat[0], side * flat[1], side * flat[2]
    return normals, weight


@njit(cache=True, nogil=True, error_model="numpy")
def _across(line: Vector, sight: Vector) -> Vector:
    """The unit vector across a line that looks most along the sight."""
    length = np.sqrt(sight[0] ** 2 + sight[1] ** 2 + sight[2] ** 2)
    sx, sy, sz = sight[0] / length, sight[1] / length, sight[2] / length
    part = sx * line[0] + sy * line[1] + sz * line[2]
    x, y, z = sx - part * line[0], sy - part * line[1], sz - part * line[2]
    length = np.sqrt(x * x + y * y + z * z)
    return (x / length, y / length, z / length) if length > 1e-9 else (sx, sy, sz)


@njit(cache=True, nogil=True, error_model="numpy")
def _flattest_mean(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    weight: NDArray[np.float64],
    indptr: NDArray[np.int64],
    indices: NDArray[np.int32],
    viewpoint: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Weighted mean of the neighbours' normals, towards the viewpoint; the own where none of them weighs anything."""
    out = np.empty_like(normals)
    for i in range(len(normals)):
        x, y, z = 0.0, 0.0, 0.0
        for place in range(indptr[i], indptr[i + 1]):
            k = np.uint64(indices[place])
            w = weight[k]
            x, y, z = x + w * normals[k, 0], y + w * normals[k, 1], z + w * normals[k, 2]
        length = np.sqrt(x * x + y * y + z * z)
        if length > 0:
            x, y, z = x / length, y / length, z / length
        else:
            x, y, z = normals[i]
        towards = (
            x * (viewpoint[0] - points[i, 0]) + y * (viewpoint[1] - points[i, 1]) + z * (viewpoint[2] - points[i, 2])
        )
        side = -1.0 if towards < 0 else 1.0
        out[i, 0], out[i, 1], out[i, 2] = side * x, side * y, side * z
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _grow(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    indptr: NDArray[np.int64],
    indices: NDArray[np.int32],
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


@njit(cache=True, nogil=True, error_model="numpy")
def _flow(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    indptr: NDArray[np.int64],
    indices: NDArray[np.int32],
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
            cx, cy, cz = centres[label]
            nx, ny, nz = directions[label]
            for k in range(indptr[front[f]], indptr[front[f] + 1]):
                i = np.uint64(indices[k])  # unsigned: no place counts from the end
                if label == labels[i]:
                    continue
                dx, dy, dz = points[i, 0] - cx, points[i, 1] - cy, points[i, 2] - cz
                bend = 1.0 - abs(normals[i, 0] * nx + normals[i, 1] * ny + normals[i, 2] * nz)
                d = normal_weight * bend + spatial_weight * np.sqrt(dx * dx + dy * dy + dz * dz)
                if d < distance[i]:
                    distance[i], labels[i], changed[i] = d, label, True
        front = np.flatnonzero(changed)


@njit(cache=True, nogil=True, error_model="numpy")
def _recentre(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    labels: NDArray[np.int64],
    centres: NDArray[np.float64],
    directions: NDArray[np.float64],
) -> None:
    """Moves centres (P, 3) and directions (P, 3), in place, to the means of their patches' voxels."""
    sums = np.zeros((len(centres), 7))
    for i in range(len(points)):
        if labels[i] >= 0:
            own = sums[labels[i]]
            own[0] += points[i, 0]
            own[1] += points[i, 1]
            own[2] += points[i, 2]
            own[3] += normals[i, 0]
            own[4] += normals[i, 1]
            own[5] += normals[i, 2]
            own[6] += 1
    for label in range(len(centres)):
        x, y, z, nx, ny, nz, count = sums[label]
        length = max(np.sqrt(nx * nx + ny * ny + nz * nz), 1e-12)
        centres[label, 0], centres[label, 1], centres[label, 2] = x / count, y / count, z / count
        directions[label, 0], directions[label, 1], directions[label, 2] = nx / length, ny / length, nz / length


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(nogil=True, error_model="numpy", inline="always")
def _dot(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(nogil=True, error_model="numpy", inline="always")
def _squared(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Squared distance."""
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2
