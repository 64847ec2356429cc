"""A scene at one point a voxel: bounds the work, whatever was sent, and forgets the order of the points."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from service.tabletop.records import TabletopParams

STEP = 1e-5  # metres: points are snapped to whole numbers of it, whose sums know no rounding and so no order
POINTS_A_VOXEL = 2.0  # on average, at least: sparser scenes get larger voxels, or their surfaces would have holes
COARSEST = 0.05  # metres: no larger voxels for the sake of holes


class Voxels(NamedTuple):
    """A scene's occupied voxels, in the order of their keys.

    Attributes:
        points: (V, 3) float64, metres: the mean of each voxel's points.
        counts: (V,) int64: the points of each.
        rows: (N,) int64: the points of the cloud that are within reach, ascending.
        of_row: (N,) int64: the voxel of each of those.
        size: the voxels' edge, metres.
    """

    points: NDArray[np.float64]
    counts: NDArray[np.int64]
    rows: NDArray[np.int64]
    of_row: NDArray[np.int64]
    size: float


def voxelise(points: NDArray[np.float32], params: TabletopParams) -> Voxels:
    """Averages the points of each voxel; voxels grow until they are no more than `max_voxels` and hold some points.

    Args:
        points: (N, 3), metres, sensor's frame.
        params: reach, voxel and max_voxels are used.
    """
    rows = _within(points, params.reach)
    lattice = [_snap(points[rows, axis]) for axis in range(3)]
    low = round(params.reach / STEP) + 1
    edge = round(params.voxel / STEP)
    while True:
        across = 2 * low // edge + 1
        x, y, z = ((whole + low) // edge for whole in lattice)
        keys, of_row, counts = np.unique(
            (x.astype(np.int64) * across + y) * across + z, return_inverse=True, return_counts=True
        )
        if len(keys) > params.max_voxels:
            edge = round(edge * max(1.2, (len(keys) / params.max_voxels) ** 0.4))
        elif len(rows) < POINTS_A_VOXEL * len(keys) and edge * STEP < COARSEST:
            edge = min(round(edge * 1.2), round(COARSEST / STEP))
        else:
            break
    sums = np.stack([np.bincount(of_row, whole, len(keys)) for whole in lattice], axis=1)
    return Voxels(sums / counts[:, None] * STEP, counts, rows, of_row, edge * STEP)


def _within(points: NDArray[np.float32], reach: float) -> NDArray[np.int64]:
    """The rows of points (N, 3) that are measured and not farther from the origin."""
    x, y, z = points.T
    with np.errstate(over="ignore", invalid="ignore"):
        return np.flatnonzero(np.square(x) + np.square(y) + np.square(z) <= np.float32(reach**2))


def _snap(metres: NDArray[np.float32]) -> NDArray[np.int32]:
    return np.rint(metres.astype(np.float64) / STEP).astype(np.int32)
