"""Point clouds: what the engine takes, and how it is made independent of order, place, attitude and size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from service.engine.errors import (
    DegenerateCloud,
    DistantCloud,
    EmptyCloud,
    ImplausibleExtent,
    NoFinitePoints,
    TooFewPoints,
)
from service.engine.neighbours import touching
from service.engine.params import CloudParams

LATTICE_BITS = 21  # three coordinates of 21 bits fit one 63-bit key
STRAY = 32.0  # median distances from the middle beyond which a point is no part of any object
TRIM = 4.0  # points farther from the centre than this many median distances are outliers
FARTHEST = 1e4  # extents; beyond, the steps of float32 coordinates approach a voxel
LINE = 1e-4  # variance across, relative to the variance along, below which points are a line
COARSEST_VOXEL = 0.2  # share of the extent


@dataclass(frozen=True)
class PointCloud:
    """What a sensor measured of one object, in the sensor's frame.

    Attributes:
        points: (N, 3) float32, metres, finite; the sensor at the origin, x right, y down, z forward.
        measured: (M,) bool: which of the M points of a file these N are; None where they are all of them.
    """

    points: NDArray[np.float32]
    measured: NDArray[np.bool_] | None = None


@dataclass(frozen=True)
class Frame:
    """An object's own frame: centred, along its principal axes, its robust extent 1.

    Attributes:
        centre: (3,) float64, metres, in the sensor's frame.
        axes: (3, 3) float64, right-handed: the columns are the own axes in the sensor's frame.
        extent: the object's robust diameter, metres.
    """

    centre: NDArray[np.float64]
    axes: NDArray[np.float64]
    extent: float

    @property
    def viewpoint(self) -> NDArray[np.float64]:
        """Where the sensor stood (3,), extents."""
        return -self.centre @ self.axes / self.extent

    def to_sensor(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (M, 3) of the own frame, in the sensor's, metres."""
        return points @ self.axes.T * self.extent + self.centre


@dataclass(frozen=True)
class NormalisedCloud:
    """A cloud in its own frame.

    Attributes:
        points: (N, 3) float64, extents; sorted, so that nothing depends on the order in which points came.
        frame: where the points lie.
        warnings: what is odd about the cloud, in sentences.
    """

    points: NDArray[np.float64]
    frame: Frame
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class VoxelCloud:
    """A cloud at one point a voxel.

    Attributes:
        points: (M, 3) float64, extents: the mean of each voxel's points, in the order of the voxels' keys.
        cells: (M, 3) int32: the voxel's place in the grid.
        size: the voxel's edge, extents.
        frame: where the points lie.
    """

    points: NDArray[np.float64]
    cells: NDArray[np.int32]
    size: float
    frame: Frame


def normalise(cloud: PointCloud, params: CloudParams) -> NormalisedCloud:
    """Brings a cloud into its own frame, whatever its order, place, attitude and size.

    The frame is that of the principal axes; a cloud that is moved, turned together with its viewpoint, or rescaled
    has the same coordinates, to the rounding of its float32 points.

    Raises:
        InvalidCloud: one of its children, saying what is wrong with the cloud.
    """
    points = _in_order(_without_strays(_checked(cloud, params)))
    centre, radius = _centre(points)
    _check_extent(2 * radius, params)
    _check_distance(float(np.linalg.norm(centre)), 2 * radius)
    points = points[_distances(points, centre) <= 1.5 * radius]
    if len(points) < params.min_points:
        raise TooFewPoints(
            f"The object has {len(points)} points beside scattered ones, fewer than the {params.min_points} needed. "
            "Send the object alone, or move the sensor closer."
        )
    frame = Frame(centre, _principal_axes(points - centre), 2 * radius)
    return NormalisedCloud((points - centre) @ frame.axes / frame.extent, frame, _warnings(centre, radius))


def downsample(cloud: NormalisedCloud, params: CloudParams) -> VoxelCloud:
    """Averages the points of each voxel, and drops islands of a few voxels: scattered returns.

    A sparse cloud gets larger voxels, so that its surface has no holes; so does one that fills its volume, so that the
    work stays bounded.
    """
    size = params.voxel
    while True:
        sums, cells = _voxel_sums(cloud.points, size)
        fine = len(cloud.points) >= params.points_per_voxel * len(sums) and len(sums) <= params.max_voxels
        if fine or size >= COARSEST_VOXEL:
            break
        size = min(size * 2**0.25, COARSEST_VOXEL)
    island = touching(cells).islands()
    voxels = np.bincount(island)
    kept = (voxels >= min(params.min_island * len(cells), voxels.max()))[island]
    return VoxelCloud(sums[kept, :3] / sums[kept, 3:], cells[kept], size, cloud.frame)


def _checked(cloud: PointCloud, params: CloudParams) -> NDArray[np.float64]:
    """The cloud's points as float64, if they are enough and not all alike."""
    points = np.asarray(cloud.points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise EmptyCloud(f"A cloud is an array of N x 3 coordinates; this one has the shape {points.shape}.")
    if len(points) == 0:
        raise EmptyCloud("The cloud holds no point. Send the points that the sensor measured of one object.")
    finite = np.isfinite(points)
    if not finite.all():
        points = points[finite.all(axis=1)]
    if len(points) == 0:
        raise NoFinitePoints("Every point of the cloud is NaN or infinite: the sensor measured nothing there.")
    if len(points) < params.min_points:
        raise TooFewPoints(
            f"The cloud has {len(points)} points; at least {params.min_points} are needed. "
            "Move the sensor closer, or send the cloud at a higher resolution."
        )
    return points


def _without_strays(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """The points without those beyond all proportion, which would coarsen the lattice; medians know no order."""
    distance = _distances(points, _medians(points))
    typical = np.median(distance)
    if typical == 0:
        raise DegenerateCloud(
            f"{np.count_nonzero(distance == 0)} of the {len(points)} points of the cloud coincide: there is no surface "
            "to describe."
        )
    return points[distance <= STRAY * typical]


def _in_order(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Snaps points to a lattice of 2^21 steps over their bounds and sorts them, so that their order is forgotten."""
    low = points.min(axis=0)
    step = (points.max(axis=0) - low).max() / (2**LATTICE_BITS - 1)
    return _of_keys(np.sort(_keys(points, low, step)), low, step)


def _centre(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Trimmed mean (3,), and the radius about it that holds 98 % of the points that are not outliers."""
    centre = _medians(points)
    for _ in range(4):
        distance = _distances(points, centre)
        centre = _mean_within(points, distance, TRIM * np.median(distance))
    distance = _distances(points, centre)
    kept = distance <= TRIM * np.median(distance)
    return centre, float(np.quantile(distance[kept], 0.98))


def _medians(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """The median of each coordinate (3,)."""
    return np.asarray(np.median(np.ascontiguousarray(points.T), axis=1))


def _check_extent(extent: float, params: CloudParams) -> None:
    if extent > params.max_extent:
        raise ImplausibleExtent(
            f"The object would be {extent:.3g} m across, more than {params.max_extent:g} m. Clouds are read in metres: "
            "if its coordinates are millimetres, send unit=mm; a whole room or map must be cut into objects first."
        )
    if extent < params.min_extent:
        raise ImplausibleExtent(
            f"The object would be {extent:.3g} m across, less than {params.min_extent:g} m. Clouds are read in metres: "
            "state the unit of its coordinates if they are of another one."
        )


def _check_distance(distance: float, extent: float) -> None:
    if distance > FARTHEST * extent:
        raise DistantCloud(
            f"The object, {extent:.3g} m across, would be {distance:.3g} m from the sensor, where its coordinates "
            "are too coarse. If they are of a map or a robot's base, state the viewpoint from which the cloud was seen."
        )


def _principal_axes(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Columns (3, 3): the axes of largest to smallest variance, right-handed, the skewed side positive."""
    variance, axes = np.linalg.eigh(points.T @ points / len(points))
    if variance[1] < LINE * variance[2]:
        raise DegenerateCloud(
            f"The {len(points)} points of the cloud lie on one line: there is no surface to describe. "
            "Check that all three coordinates were filled in."
        )
    axes = axes[:, ::-1]
    skew = np.einsum("ij,ij,ij->j", *[points @ axes] * 3)
    axes = axes * np.where(skew < 0, -1.0, 1.0)
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    return axes


def _warnings(centre: NDArray[np.float64], radius: float) -> tuple[str, ...]:
    if np.linalg.norm(centre) < radius:
        return ("The sensor would stand inside the object: state the viewpoint from which the cloud was seen.",)
    if centre[2] < 0:
        return ("The object lies behind the sensor, which looks along +z: state the viewpoint of the cloud.",)
    return ()


def _voxel_sums(points: NDArray[np.float64], size: float) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Sums of coordinates and counts (M, 4), and cells (M, 3), of the occupied voxels in the order of their keys."""
    cells = np.floor(points / size).astype(np.int32)
    low = cells.min(axis=0)
    shape = (cells.max(axis=0) - low + 1).astype(np.int64)
    sums = _accumulate(points, cells, low, shape)
    occupied = np.flatnonzero(sums[:, 3])
    return sums[occupied], np.stack(np.unravel_index(occupied, tuple(shape)), axis=1).astype(np.int32)


@njit(cache=True, nogil=True)
def _accumulate(
    points: NDArray[np.float64], cells: NDArray[np.int32], low: NDArray[np.int32], shape: NDArray[np.int64]
) -> NDArray[np.float64]:
    sums = np.zeros((shape[0] * shape[1] * shape[2], 4))
    for i in range(len(cells)):
        key = ((cells[i, 0] - low[0]) * shape[1] + cells[i, 1] - low[1]) * shape[2] + cells[i, 2] - low[2]
        for axis in range(3):
            sums[key, axis] += points[i, axis]
        sums[key, 3] += 1
    return sums


@njit(cache=True, nogil=True)
def _distances(points: NDArray[np.float64], centre: NDArray[np.float64]) -> NDArray[np.float64]:
    """From each point (N, 3) to one (3,)."""
    out = np.empty(len(points))
    for i in range(len(points)):
        dx, dy, dz = points[i, 0] - centre[0], points[i, 1] - centre[1], points[i, 2] - centre[2]
        out[i] = np.sqrt(dx * dx + dy * dy + dz * dz)
    return out


@njit(cache=True, nogil=True)
def _mean_within(points: NDArray[np.float64], distance: NDArray[np.float64], limit: float) -> NDArray[np.float64]:
    """Mean (3,) of the points whose distance is within a limit."""
    total = np.zeros(3)
    count = 0
    for i in range(len(points)):
        if distance[i] <= limit:
            count += 1
            for axis in range(3):
                total[axis] += points[i, axis]
    return total / count


@njit(cache=True, nogil=True)
def _keys(points: NDArray[np.float64], low: NDArray[np.float64], step: float) -> NDArray[np.int64]:
    """Places (N,) on a lattice, x before y before z."""
    out = np.empty(len(points), np.int64)
    for i in range(len(points)):
        key = 0
        for axis in range(3):
            key = (key << LATTICE_BITS) | int(np.rint((points[i, axis] - low[axis]) / step))
        out[i] = key
    return out


@njit(cache=True, nogil=True)
def _of_keys(keys: NDArray[np.int64], low: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """The points (N, 3) of `_keys`."""
    out = np.empty((len(keys), 3))
    for i in range(len(keys)):
        for axis in range(3):
            place = keys[i] >> (2 - axis) * LATTICE_BITS & (2**LATTICE_BITS - 1)
            out[i, axis] = place * step + low[axis]
    return out
