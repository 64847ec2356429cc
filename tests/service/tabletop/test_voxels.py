"""A scene at one point a voxel: exact means, no order, and no more voxels than are looked at."""

from __future__ import annotations

import numpy as np
import pytest

from service.tabletop.records import TabletopParams
from service.tabletop.voxels import STEP, voxelise


def some_points(count: int, across: float = 1.0) -> np.ndarray:
    return np.random.default_rng(0).uniform(-across / 2, across / 2, (count, 3)).astype(np.float32)


def test_a_voxels_point_is_the_mean_of_its_points() -> None:
    points = some_points(5000)
    voxels = voxelise(points, TabletopParams(voxel=0.1))
    assert voxels.counts.sum() == len(points)
    for number in range(0, len(voxels.points), 50):
        own = points[voxels.rows[voxels.of_row == number]]
        assert len(own) == voxels.counts[number]
        np.testing.assert_allclose(voxels.points[number], own.mean(axis=0), atol=STEP)
        assert np.ptp(own, axis=0).max() <= 0.1 + STEP


def test_points_in_another_order_have_the_same_voxels_to_the_bit() -> None:
    points = some_points(5000)
    one, other = (voxelise(each, TabletopParams(voxel=0.05)) for each in (points, points[::-1]))
    np.testing.assert_array_equal(one.points, other.points)
    np.testing.assert_array_equal(one.of_row, other.of_row[::-1])


@pytest.mark.parametrize("across", [0.1, 1.0, 11.0])
def test_voxels_grow_until_they_are_few_enough(across: float) -> None:
    voxels = voxelise(some_points(30_000, across), TabletopParams(max_voxels=1000))
    assert len(voxels.points) <= 1000
    assert len(voxels.rows) == 30_000


def test_what_is_far_or_was_not_measured_is_in_no_voxel() -> None:
    points = some_points(10)
    points[3], points[5], points[7, 1] = np.nan, [0, 0, 10.1], np.inf
    assert voxelise(points, TabletopParams()).rows.tolist() == [0, 1, 2, 4, 6, 8, 9]
    assert len(voxelise(points[:0], TabletopParams()).points) == 0
