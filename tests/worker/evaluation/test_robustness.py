"""Disturbances do what they say, and the curves count what they must."""

from __future__ import annotations

import hashlib
from functools import cache

import numpy as np
import pytest

from service.engine.cloud import PointCloud
from service.engine.params import CloudParams
from service.engine.segments import SegmentGraph
from tests.learnt import objects
from tests.shapes import ball, look, see
from worker.evaluation.baselines import see_whole
from worker.evaluation.robustness import (
    DISTURBANCES,
    REFUSED,
    Disturbance,
    blur,
    curves,
    disturbed,
    hide,
    rescale,
    thin,
)
from worker.simulation.sensor import axial_sigma

DIGEST = hashlib.sha256(b"a cloud").hexdigest()


@cache
def seen() -> tuple[PointCloud, SegmentGraph]:
    cloud = objects()[0].cloud
    return cloud, see_whole(cloud, CloudParams())


def kind(name: str) -> Disturbance:
    return next(each for each in DISTURBANCES if each.name == name)


def rows(cloud: PointCloud) -> set[bytes]:
    return {point.tobytes() for point in cloud.points}


@pytest.mark.parametrize("each", DISTURBANCES, ids=lambda each: each.name)
def test_the_neutral_strength_leaves_a_cloud_as_it_is(each: Disturbance) -> None:
    cloud, whole = seen()
    same = each.apply(cloud, whole, each.neutral, np.random.default_rng(0))
    assert same.points == pytest.approx(cloud.points, abs=1e-6)
    assert each.neutral not in each.strengths


def test_draws_follow_from_the_content_alone() -> None:
    first, again = disturbed(*seen(), DIGEST), disturbed(*seen(), DIGEST)
    assert [each.points.tobytes() for each in first] == [each.points.tobytes() for each in again]
    other = disturbed(*seen(), hashlib.sha256(b"another").hexdigest())
    assert sum(a.points.tobytes() != b.points.tobytes() for a, b in zip(first, other, strict=True)) >= 10
    assert len(first) == sum(len(each.strengths) for each in DISTURBANCES)


def test_rescaling_keeps_the_image() -> None:
    cloud, whole = seen()
    larger = rescale(cloud, whole, 3, np.random.default_rng(0))
    assert larger.points[:, :2] / larger.points[:, 2:] == pytest.approx(cloud.points[:, :2] / cloud.points[:, 2:])
    assert np.ptp(larger.points, axis=0) == pytest.approx(3 * np.ptp(cloud.points, axis=0), rel=1e-5)


def test_thinning_leaves_one_of_so_many_points_and_more_of_it_takes_more() -> None:
    cloud, whole = seen()
    half, tenth = (thin(cloud, whole, factor, np.random.default_rng(1)) for factor in (2, 10))
    assert len(half.points) == round(len(cloud.points) / 2)
    assert len(tenth.points) == round(len(cloud.points) / 10)
    assert rows(tenth) < rows(half) < rows(cloud)


def test_noise_moves_points_along_their_line_of_sight() -> None:
    cloud, whole = seen()
    noisy = blur(cloud, whole, 2, np.random.default_rng(0))
    assert noisy.points[:, :2] / noisy.points[:, 2:] == pytest.approx(
        cloud.points[:, :2] / cloud.points[:, 2:], abs=1e-5
    )


def test_noise_is_as_strong_as_the_sensor_s_where_it_looks_straight_at_a_surface() -> None:
    cloud = see(ball(0.1), look(0, 0, 0.9)).cloud
    whole = see_whole(cloud, CloudParams())
    near = cloud.points[:, 2] < cloud.points[:, 2].min() + 0.005
    moved = blur(cloud, whole, 2, np.random.default_rng(0)).points[near, 2] - cloud.points[near, 2]
    sigma = axial_sigma(np.array([0.8]), np.array([0.0]))[0]
    assert near.sum() > 200
    assert moved.std() == pytest.approx(np.sqrt(3) * sigma, rel=0.15)  # 1 + 3 variances are 4 of them
    assert abs(moved.mean()) < 0.3 * sigma


def test_more_noise_is_the_same_noise_only_more() -> None:
    cloud, whole = seen()
    twice, thrice = (blur(cloud, whole, f, np.random.default_rng(3)).points - cloud.points for f in (2, 3))
    assert thrice == pytest.approx(np.sqrt(8 / 3) * twice, abs=1e-6)


def test_what_is_hidden_lies_beyond_a_straight_edge_of_the_image() -> None:
    cloud, whole = seen()
    some, more = (hide(cloud, whole, share, np.random.default_rng(5)) for share in (0.1, 0.3))
    assert len(some.points) == pytest.approx(0.9 * len(cloud.points), abs=1)
    assert rows(more) < rows(some)
    azimuth = np.random.default_rng(5).uniform(0, 2 * np.pi)
    along = np.array([np.cos(azimuth), np.sin(azimuth)])
    hidden = np.array([point for point in cloud.points if point.tobytes() not in rows(more)])
    image = [points[:, :2] / points[:, 2:] @ along for points in (more.points, hidden)]
    assert image[0].max() <= image[1].min() + 1e-6


def test_curves_count_who_keeps_the_best_concept_and_what_is_in_use() -> None:
    best = np.array([7, 7, 8, 9])
    strengths = sum(len(each.strengths) for each in DISTURBANCES)
    under = np.tile(best[:, None], (1, strengths))
    first = len(kind("rescaled").strengths)
    under[:, first] = [7, 8, 8, REFUSED]
    robustness = curves(best, list(under))
    assert (robustness.clouds, robustness.in_use) == (4, 3)
    thinned = next(curve for curve in robustness.curves if curve.name == "thinned")
    assert [(at.strength, at.kept, at.in_use, at.refused) for at in thinned.strengths[:3]] == [
        (1, 1.0, 3, 0),
        (2, 0.5, 2, 1),
        (3, 1.0, 3, 0),
    ]


def test_a_curve_runs_from_little_to_much_and_holds_the_undisturbed_clouds() -> None:
    best = np.array([1, 2])
    strengths = sum(len(each.strengths) for each in DISTURBANCES)
    for each, curve in zip(DISTURBANCES, curves(best, [np.full(strengths, b) for b in best]).curves, strict=True):
        found = [at.strength for at in curve.strengths]
        assert found == sorted({*each.strengths, each.neutral})
        assert all(at.kept == 1 for at in curve.strengths)
