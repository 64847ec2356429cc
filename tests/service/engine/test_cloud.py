"""A cloud in its own frame: whatever its order, place, attitude and size, and whatever is wrong with it."""

from __future__ import annotations

import time
import tracemalloc

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from service.engine.cloud import PointCloud, VoxelCloud, downsample, normalise
from service.engine.errors import (
    DegenerateCloud,
    DistantCloud,
    EmptyCloud,
    ImplausibleExtent,
    NoFinitePoints,
    TooFewPoints,
)
from service.engine.params import CloudParams
from tests.shapes import about_optical_axis, box, cloud_of, corner_view, look, see

PARAMS = CloudParams()
STEP = 2**-20  # of the extent: twice the lattice on which order is forgotten


@pytest.fixture(scope="module")
def points() -> NDArray[np.float64]:
    """A box of three different edges, seen at a corner: no two of its axes can be confused."""
    return see(box(0.1, 0.15, 0.22), corner_view(0, 0.9), "kinect").cloud.points.astype(np.float64)


def in_own_frame(points: NDArray[np.float64]) -> NDArray[np.float64]:
    return normalise(cloud_of(points), PARAMS).points


def nearest(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """The largest distance of a point of one cloud from the other cloud."""
    return float(max(cKDTree(a).query(b)[0].max(), cKDTree(b).query(a)[0].max()))


@pytest.mark.parametrize("seed", range(3))
def test_the_order_of_the_points_is_forgotten(points: NDArray[np.float64], seed: int):
    shuffled = np.random.default_rng(seed).permutation(points)
    a, b = normalise(cloud_of(points), PARAMS), normalise(cloud_of(shuffled), PARAMS)
    assert np.array_equal(a.points, b.points)
    assert a.frame.extent == b.frame.extent
    assert np.array_equal(a.frame.axes, b.frame.axes)


@pytest.mark.parametrize("degrees", [10, 37, 90, 180, 271])
def test_a_cloud_turned_about_the_optical_axis_has_the_same_coordinates(points: NDArray[np.float64], degrees: float):
    assert nearest(in_own_frame(points), in_own_frame(points @ about_optical_axis(degrees).T)) < 2 * STEP


@pytest.mark.parametrize("shift", [(0.3, 0, 0), (0, -0.2, 0), (0, 0, 0.5), (-0.1, 0.1, -0.2)])
def test_a_moved_cloud_has_the_same_coordinates(points: NDArray[np.float64], shift: tuple[float, float, float]):
    assert nearest(in_own_frame(points), in_own_frame(points + shift)) < 2 * STEP


@pytest.mark.parametrize("factor", [0.05, 0.7, 3.0, 20.0])
def test_a_rescaled_cloud_has_the_same_coordinates_and_another_extent(points: NDArray[np.float64], factor: float):
    a, b = normalise(cloud_of(points), PARAMS), normalise(cloud_of(points * factor), PARAMS)
    assert nearest(a.points, b.points) < 2 * STEP
    assert b.frame.extent == pytest.approx(factor * a.frame.extent, rel=1e-5)


def test_the_frame_leads_back_to_the_sensor(points: NDArray[np.float64]):
    normalised = normalise(cloud_of(points), PARAMS)
    assert nearest(normalised.frame.to_sensor(normalised.points), points) < 2 * STEP * normalised.frame.extent
    assert np.allclose(normalised.frame.to_sensor(normalised.frame.viewpoint[None]), 0, atol=1e-12)
    assert np.allclose(normalised.frame.axes @ normalised.frame.axes.T, np.eye(3))
    assert np.linalg.det(normalised.frame.axes) == pytest.approx(1)


def test_the_extent_is_that_of_the_object_in_metres(points: NDArray[np.float64]):
    true = 2 * np.linalg.norm(points - points.mean(axis=0), axis=1).max()
    assert normalise(cloud_of(points), PARAMS).frame.extent == pytest.approx(true, rel=0.15)


@pytest.mark.parametrize("share", [0.001, 0.02])
def test_outliers_do_not_change_the_extent(points: NDArray[np.float64], share: float):
    rng = np.random.default_rng(1)
    scattered = points.mean(axis=0) + rng.uniform(-5, 5, (int(share * len(points)), 3))
    clean, dirty = (normalise(cloud_of(p), PARAMS) for p in (points, np.concatenate([points, scattered])))
    assert dirty.frame.extent == pytest.approx(clean.frame.extent, rel=0.02)
    assert len(dirty.points) <= len(points) + 3


def test_the_cloud_itself_is_not_touched(points: NDArray[np.float64]):
    cloud = cloud_of(points)
    before = cloud.points.copy()
    downsample(normalise(cloud, PARAMS), PARAMS)
    assert np.array_equal(cloud.points, before)


def test_points_that_the_sensor_did_not_measure_are_passed_over(points: NDArray[np.float64]):
    holes = np.full((50, 3), np.nan)
    holes[:10, 0] = np.inf
    with_holes = np.random.default_rng(0).permutation(np.concatenate([points, holes]))
    assert np.array_equal(in_own_frame(with_holes), in_own_frame(points))


def line(count: int, thickness: float = 0.0) -> NDArray[np.float64]:
    along = np.linspace(0, 0.2, count)[:, None] * [1, 2, 0.5] + [0, 0, 1]
    return along + np.random.default_rng(0).normal(0, thickness or 1e-300, (count, 3))


surface = np.random.default_rng(0).random((400, 3)) * [0.2, 0.2, 0.02]
WRONG = {
    "no points": (np.zeros((0, 3)), EmptyCloud),
    "no coordinates": (np.zeros(12), EmptyCloud),
    "two coordinates": (np.zeros((200, 2)), EmptyCloud),
    "nothing measured": (np.full((500, 3), np.nan), NoFinitePoints),
    "everything infinite": (np.full((500, 3), np.inf), NoFinitePoints),
    "one point": (np.ones((1, 3)), TooFewPoints),
    "one point too few": (surface[:99], TooFewPoints),
    "one point too few that is finite": (np.concatenate([surface[:99], np.full((50, 3), np.nan)]), TooFewPoints),
    "one point many times": (np.ones((1000, 3)), DegenerateCloud),
    "a line": (line(1000), DegenerateCloud),
    "a line along an axis": (np.linspace(0, 1, 500)[:, None] * [0, 0, 1], DegenerateCloud),
    "two points many times": (np.repeat([[0, 0, 1], [0.1, 0, 1]], 200, axis=0), DegenerateCloud),
    "a nearly perfect line": (line(1000, 1e-5), DegenerateCloud),
    "an object of 300 m": (surface * 1500, ImplausibleExtent),
    "an object in millimetres": (surface * 1000, ImplausibleExtent),
    "an object of a micrometre": (surface * 5e-6, ImplausibleExtent),
    "the largest numbers there are": (surface * 1e38, ImplausibleExtent),
    "a small object among scattered points": (np.concatenate([surface[:80], surface[80:120] * 50]), TooFewPoints),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_no_object_is_refused_with_its_own_error(what: str):
    points, error = WRONG[what]
    with np.errstate(all="raise", under="ignore"), pytest.raises(error) as refusal:
        normalise(PointCloud(points.astype(np.float32)), PARAMS)
    assert type(refusal.value) is error
    assert len(str(refusal.value)) > 40


def test_wrong_units_are_guessed_aloud():
    with pytest.raises(ImplausibleExtent, match="unit=mm"):
        normalise(cloud_of(surface * 1000), PARAMS)


def test_a_sensor_that_would_stand_inside_or_before_the_object_is_wondered_at(points: NDArray[np.float64]):
    assert normalise(cloud_of(points), PARAMS).warnings == ()
    assert "inside" in normalise(cloud_of(points - points.mean(axis=0)), PARAMS).warnings[0]
    assert "behind" in normalise(cloud_of(points * [-1, 1, -1]), PARAMS).warnings[0]


def voxels(points: NDArray[np.float64], params: CloudParams = PARAMS) -> VoxelCloud:
    return downsample(normalise(cloud_of(points), params), params)


def test_voxels_hold_the_mean_of_their_points(points: NDArray[np.float64]):
    normalised = normalise(cloud_of(points), PARAMS)
    cloud = downsample(normalised, PARAMS)
    cells = np.floor(normalised.points / cloud.size).astype(int)
    for k in range(0, len(cloud.points), 37):
        inside = (cells == np.floor(cloud.points[k] / cloud.size)).all(axis=1)
        assert np.allclose(cloud.points[k], normalised.points[inside].mean(axis=0))
    assert len(np.unique(cloud.cells, axis=0)) == len(cloud.points)


def test_a_sparse_cloud_gets_larger_voxels(points: NDArray[np.float64]):
    sparse = np.random.default_rng(0).permutation(points)[:300]
    assert voxels(points).size == PARAMS.voxel
    assert voxels(sparse).size > 1.5 * PARAMS.voxel
    assert len(sparse) >= PARAMS.points_per_voxel * len(voxels(sparse).points)


def test_scattered_returns_near_the_object_are_dropped(points: NDArray[np.float64]):
    speck = points.mean(axis=0) - np.array([0, 0, 0.15]) + np.random.default_rng(0).normal(0, 1e-3, (20, 3))
    with_speck = voxels(np.concatenate([points, speck]))
    near = np.linalg.norm(with_speck.frame.to_sensor(with_speck.points) - speck.mean(axis=0), axis=1)
    assert near.min() > 0.03


def test_a_plane_and_a_hundred_points_are_clouds_like_any_other():
    plane = np.random.default_rng(0).random((2000, 3)) * [0.2, 0.3, 0] + [0, 0, 1]
    assert len(voxels(plane).points) > 100
    hundred = see(box(0.1, 0.15, 0.22), look(30, 30, 0.9)).cloud.points
    hundred = hundred[:: len(hundred) // 100][:100]
    assert len(voxels(hundred).points) > 10


def test_a_million_points_take_seconds_and_little_more_memory_than_they_are():
    rng = np.random.default_rng(0)
    direction = rng.standard_normal((1_000_000, 3))
    cloud = cloud_of(0.1 * direction / np.linalg.norm(direction, axis=1)[:, None] + [0, 0, 1])
    voxels(cloud.points[:1000].astype(np.float64))
    tracemalloc.start()
    started = time.perf_counter()
    downsample(normalise(cloud, PARAMS), PARAMS)
    elapsed, peak = time.perf_counter() - started, tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert elapsed < 10
    assert peak < 500e6


def test_an_object_in_the_coordinates_of_a_map_is_told_to_state_its_viewpoint() -> None:
    points = np.random.default_rng(0).random((500, 3)) * 0.2
    normalise(PointCloud((points + np.array([0, 0, 500])).astype(np.float32)), CloudParams())
    with pytest.raises(DistantCloud, match="state the viewpoint"):
        normalise(PointCloud((points + np.array([5e5, 4e6, 0])).astype(np.float32)), CloudParams())


@pytest.mark.parametrize("distance", [10.0, 1e3, 1e5, 1e10, 1e30])
def test_a_stray_return_changes_nothing_however_far_it_is(points: NDArray[np.float64], distance: float) -> None:
    strayed = np.concatenate([points, [[distance, -distance, distance]]])
    there, alone = normalise(cloud_of(strayed), PARAMS), normalise(cloud_of(points), PARAMS)
    assert len(there.points) == len(alone.points)
    assert np.abs(there.points - alone.points).max() < 1e-3
    assert there.frame.extent == pytest.approx(alone.frame.extent, rel=1e-3)


@pytest.mark.parametrize("share", [0.6, 0.99])
def test_a_cloud_of_which_most_points_coincide_is_told_so(share: float) -> None:
    points = np.random.default_rng(0).random((1000, 3)) * 0.2 + [0, 0, 1]
    points[: int(share * 1000)] = [0.1, 0.1, 1.1]
    with pytest.raises(DegenerateCloud, match=f"{int(share * 1000)} of the 1000 points"):
        normalise(cloud_of(points), PARAMS)
