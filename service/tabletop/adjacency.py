"""Which objects are near one another, and which may hide a part of another from the sensor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

BESIDE_VOXELS = 2.5  # across the line of sight, within which one object is seen beside another
LEAST_BESIDE = 3  # voxels that are so: one or two may be strays


def sights_of(points: NDArray[np.float64]) -> tuple[cKDTree, NDArray[np.float64]]:
    """The directions in which points (N, 3) are seen, of unit length, and how far away they are (N,), metres."""
    distances = np.linalg.norm(points, axis=1)
    return cKDTree(points / distances[:, None]), distances


def hides(
    one: tuple[cKDTree, NDArray[np.float64]], other: tuple[cKDTree, NDArray[np.float64]], beside: float, gap: float
) -> bool:
    """Whether one object is seen right beside another and nearer, so that it may hide a part of it.

    Args:
        one: directions and distances of the one that may hide.
        other: those of the one that may be hidden.
        beside: metres across the line of sight, at the nearer one, that are still beside.
        gap: metres along the line of sight by which it is nearer.
    """
    (near, ranges), (far, far_ranges) = one, other
    angle = beside / ranges.min()
    if (near.mins - far.maxes > angle).any() or (far.mins - near.maxes > angle).any():
        return False
    away, match = near.query(far.data, distance_upper_bound=angle)
    seen = np.flatnonzero(np.isfinite(away))
    return bool(np.count_nonzero(ranges[match[seen]] + gap < far_ranges[seen]) >= LEAST_BESIDE)


def near(one: cKDTree, other: cKDTree, gap: float) -> bool:
    """Whether a point of one set is less than `gap` from one of another."""
    if (one.mins - other.maxes > gap).any() or (other.mins - one.maxes > gap).any():
        return False
    return bool(np.isfinite(one.query(other.data, distance_upper_bound=gap)[0]).any())
