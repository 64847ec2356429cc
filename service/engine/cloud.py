"""Point clouds: what the engine takes, and how it is made independent of order, place, attitude and size."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

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
from service.engine.grid import means_of, occupied_cells
from service.engine.neighbours import Neighbourhood, touching
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
        points: (N, 3) float64, extents, a column a coordinate; sorted, so that nothing depends on the order in which
            points came.
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

    @cached_property
    def adjacent(self) -> Neighbourhood:
        """Which voxels touch."""
        return touching(self.cells)


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
    points = _kept(points, _distances(points, centre) <= 1.5 * radius)
    if points.shape[1] < params.min_points:
        raise TooFewPoints(
            f"The object has {points.shape[1]} points beside scattered ones, fewer than the {params.min_points} "
            "needed. Send the object alone, or move the sensor closer."
        )
    axes, own = _along_principal_axes(points, centre, 2 * radius)
    return NormalisedCloud(own.T, Frame(centre, axes, 2 * radius), _warnings(centre, radius))


def downsample(cloud: NormalisedCloud, params: CloudParams) -> VoxelCloud:
    """Averages the points of each voxel, and drops islands of a few voxels: scattered returns.

    A sparse cloud gets larger voxels, so that its surface has no holes; so does one that fills its volume, so that the
    work stays bounded.
    """
    points, size = cloud.points.T, params.voxel
    while True:
        voxels, keys, shape = occupied_cells(points, size)
        fine = points.shape[1] >= params.points_per_voxel * len(keys) and len(keys) <= params.max_voxels
        if fine or size >= COARSEST_VOXEL:
            break
        size = min(size * 2**0.25, COARSEST_VOXEL)
    means = means_of(points, voxels, len(keys))
    cells = np.stack(np.unravel_index(keys, shape), axis=1).astype(np.int32)
    return _without_specks(VoxelCloud(means, cells, size, cloud.frame), params.min_island)


def _without_specks(cloud: VoxelCloud, least: float) -> VoxelCloud:
    """The voxels without the islands that hold less than this share of them."""
    island = cloud.adjacent.islands()
    count = np.bincount(island)
    kept = (count >= min(least * len(island), count.max()))[island]
    return cloud if kept.all() else VoxelCloud(cloud.points[kept], cloud.cells[kept], cloud.size, cloud.frame)


def _checked(cloud: PointCloud, params: CloudParams) -> NDArray[np.float64]:
    """The cloud's points (3, N) as float64, if they are enough and not all alike."""
    given = np.asarray(cloud.points)
    if given.ndim != 2 or given.shape[1] != 3:
        raise EmptyCloud(f"A cloud is an array of N x 3 coordinates; this one has the shape {given.shape}.")
    if len(given) == 0:
        raise EmptyCloud("The cloud holds no point. Send the points that the sensor measured of one object.")
    points = np.ascontiguousarray(given.T, dtype=np.float64)
    finite = np.isfinite(points)
    if not finite.all():
        points = points[:, finite.all(axis=0)]
    if points.shape[1] == 0:
        raise NoFinitePoints("Every point of the cloud is NaN or infinite: the sensor measured nothing there.")
    if points.shape[1] < params.min_points:
        raise TooFewPoints(
            f"The cloud has {points.shape[1]} points; at least {params.min_points} are needed. "
            "Move the sensor closer, or send the cloud at a higher resolution."
        )
    return points


def _without_strays(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """The points without those beyond all proportion, which would coarsen the lattice; medians know no order."""
    distance = _distances(points, _medians(points))
    typical = _median(distance)
    if typical == 0:
        raise DegenerateCloud(
            f"{np.count_nonzero(distance == 0)} of the {points.shape[1]} points of the cloud coincide: there is no "
            "surface to describe."
        )
    return _kept(points, distance <= STRAY * typical)


def _kept(points: NDArray[np.float64], kept: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Some of the points (3, N)."""
    return points if kept.all() else points[:, kept]


def _in_order(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Snaps points to a lattice of 2^21 steps over their bounds and sorts them, so that their order is forgotten."""
    low = points.min(axis=1)
    step = (points.max(axis=1) - low).max() / (2**LATTICE_BITS - 1)
    return _of_keys(np.sort(_keys(points, low, step)), low, step)


def _centre(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Trimmed mean (3,), and the radius about it that holds 98 % of the points that are not outliers."""
    centre = _medians(points)
    for _ in range(4):
        distance = _distances(points, centre)
        centre = _mean_within(points, distance, TRIM * _median(distance))
    distance = _distances(points, centre)
    return centre, _quantile(distance[distance <= TRIM * _median(distance)], 0.98)


def _medians(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """The median of each coordinate (3,)."""
    return np.array([_median(axis) for axis in points])


def _median(values: NDArray[np.float64]) -> float:
    return _quantile(values, 0.5)


def _quantile(values: NDArray[np.float64], share: float) -> float:
    """As numpy's, by one partition: interpolated between the two values on either side."""
    place = share * (len(values) - 1)
    left = int(place)
    parted = np.partition(values, left)
    if place == left:
        return float(parted[left])
    return float(parted[left] + (place - left) * (parted[left + 1 :].min() - parted[left]))


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


def _along_principal_axes(
    points: NDArray[np.float64], centre: NDArray[np.float64], extent: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Columns (3, 3): the axes of largest to smallest variance, right-handed, the skewed side positive.

    And the points (3, N), seen from the centre, along them, in extents.
    """
    variance, axes = np.linalg.eigh(_second_moments(points, centre))
    if variance[1] < LINE * variance[2]:
        raise DegenerateCloud(
            f"The {points.shape[1]} points of the cloud lie on one line: there is no surface to describe. "
            "Check that all three coordinates were filled in."
        )
    axes = np.ascontiguousarray(axes[:, ::-1])
    own, skew = _along(points, centre, axes)
    sign = np.where(skew < 0, -1.0, 1.0)
    sign[2] = sign[0] * sign[1] * np.sign(axes[0] @ _cross(axes[1], axes[2]))  # right-handed, whatever its skew
    own *= (sign / extent)[:, None]
    return axes * sign, own


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """As numpy's, without its ceremony."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _warnings(centre: NDArray[np.float64], radius: float) -> tuple[str, ...]:
    if np.linalg.norm(centre) < radius:
        return ("The sensor would stand inside the object: state the viewpoint from which the cloud was seen.",)
    if centre[2] < 0:
        return ("The object lies behind the sensor, which looks along +z: state the viewpoint of the cloud.",)
    return ()


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def _second_moments(points: NDArray[np.float64], centre: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariance (3, 3) of points (3, N) about a centre."""
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(points.shape[1]):
        x, y, z = points[0, i] - centre[0], points[1, i] - centre[1], points[2, i] - centre[2]
        xx, xy, xz, yy, yz, zz = xx + x * x, xy + x * y, xz + x * z, yy + y * y, yz + y * z, zz + z * z
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) / points.shape[1]


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def _along(
    points: NDArray[np.float64], centre: NDArray[np.float64], axes: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points (3, N), seen from a centre, along axes, the columns of (3, 3); and the sums of their cubes (3,)."""
    out = np.empty_like(points)
    first, second, third = 0.0, 0.0, 0.0
    for i in range(points.shape[1]):
        x, y, z = points[0, i] - centre[0], points[1, i] - centre[1], points[2, i] - centre[2]
        u = x * axes[0, 0] + y * axes[1, 0] + z * axes[2, 0]
        v = x * axes[0, 1] + y * axes[1, 1] + z * axes[2, 1]
        w = x * axes[0, 2] + y * axes[1, 2] + z * axes[2, 2]
        out[0, i], out[1, i], out[2, i] = u, v, w
        first, second, third = first + u * u * u, second + v * v * v, third + w * w * w
    return out, np.array([first, second, third])


@njit(cache=True, nogil=True, error_model="numpy")
def _distances(points: NDArray[np.float64], centre: NDArray[np.float64]) -> NDArray[np.float64]:
    """From each point (3, N) to one (3,)."""
    out = np.empty(points.shape[1])
    x, y, z = centre
    for i in range(len(out)):
        dx, dy, dz = points[0, i] - x, points[1, i] - y, points[2, i] - z
        out[i] = np.sqrt(dx * dx + dy * dy + dz * dz)
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _mean_within(points: NDArray[np.float64], distance: NDArray[np.float64], limit: float) -> NDArray[np.float64]:
    """Mean (3,) of the points (3, N) whose distance is within a limit."""
    x, y, z, count = 0.0, 0.0, 0.0, 0
    for i in range(len(distance)):
        if distance[i] <= limit:
            x, y, z, count = x + points[0, i], y + points[1, i], z + points[2, i], count + 1
    return np.array([x / count, y / count, z / count])


@njit(cache=True, nogil=True, error_model="numpy")
def _keys(points: NDArray[np.float64], low: NDArray[np.float64], step: float) -> NDArray[np.int64]:
    """Places (N,) of points (3, N) on a lattice, x before y before z."""
    out = np.empty(points.shape[1], np.int64)
    for i in range(len(out)):
        x, y, z = (points[0, i] - low[0]) / step, (points[1, i] - low[1]) / step, (points[2, i] - low[2]) / step
        out[i] = int(np.rint(x)) << 2 * LATTICE_BITS | int(np.rint(y)) << LATTICE_BITS | int(np.rint(z))
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _of_keys(keys: NDArray[np.int64], low: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """The points (3, N) of `_keys`."""
    out = np.empty((3, len(keys)))
    for axis in range(3):
        for i in range(len(keys)):
            place = keys[i] >> (2 - axis) * LATTICE_BITS & (2**LATTICE_BITS - 1)
            out[axis, i] = place * step + low[axis]
    return out
