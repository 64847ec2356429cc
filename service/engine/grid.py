"""Which cells of a grid points occupy, and their means: what voxels and seeds are made of."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True, nogil=True, error_model="numpy")
def occupied_cells(
    points: NDArray[np.float64], size: float
) -> tuple[NDArray[np.int32], NDArray[np.int64], tuple[int, int, int]]:
    """The occupied cell of each of the points (3, N), their keys (M,), ascending, and the grid's shape."""
    count = points.shape[1]
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    for axis in range(3):
        low[axis], high[axis] = np.floor(points[axis].min() / size), np.floor(points[axis].max() / size)
    wide, deep = high[1] - low[1] + 1, high[2] - low[2] + 1
    number = np.zeros((high[0] - low[0] + 1) * wide * deep, np.int32)
    voxels = np.empty(count, np.int32)
    for i in range(count):
        x, y, z = np.floor(points[0, i] / size), np.floor(points[1, i] / size), np.floor(points[2, i] / size)
        voxels[i] = ((x - low[0]) * wide + (y - low[1])) * deep + (z - low[2])
    for voxel in voxels:
        number[np.uint64(voxel)] = 1
    occupied = 0
    for key in range(len(number)):
        occupied += number[key]
    keys = np.empty(occupied, np.int64)
    occupied = 0
    for key in range(len(number)):
        if number[key]:
            keys[occupied], number[key] = key, occupied
            occupied += 1
    for i in range(count):
        voxels[i] = number[np.uint64(voxels[i])]
    return voxels, keys, (high[0] - low[0] + 1, wide, deep)


@njit(cache=True, nogil=True, error_model="numpy")
def means_of(points: NDArray[np.float64], voxels: NDArray[np.int32], count: int) -> NDArray[np.float64]:
    """The mean of the points (3, N) of each voxel (M, 3)."""
    sums = np.zeros((count, 4))
    for i in range(len(voxels)):
        for axis in range(3):
            sums[voxels[i], axis] += points[axis, i]
        sums[voxels[i], 3] += 1
    out = np.empty((count, 3))
    for voxel in range(count):
        for axis in range(3):
            out[voxel, axis] = sums[voxel, axis] / sums[voxel, 3]
    return out
