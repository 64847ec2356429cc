"""The ensemble of shape functions, on clouds whose distributions are known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.shapes import rotation
from worker.evaluation.esf import BINS, HISTOGRAMS, ensemble_of_shape_functions

POINTS = 4000


def histograms(points: NDArray[np.float64]) -> NDArray[np.float64]:
    return ensemble_of_shape_functions(points).reshape(HISTOGRAMS, BINS)


def sphere() -> NDArray[np.float64]:
    directions = np.random.default_rng(1).standard_normal((POINTS, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def disc() -> NDArray[np.float64]:
    rng = np.random.default_rng(2)
    radius, azimuth = np.sqrt(rng.random(POINTS)), rng.uniform(0, 2 * np.pi, POINTS)
    return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), np.zeros(POINTS)], axis=1)


def test_a_vector_is_a_distribution_over_640_bins() -> None:
    vector = ensemble_of_shape_functions(sphere())
    assert vector.shape == (640,)
    assert vector.sum() == pytest.approx(1)
    assert (vector >= 0).all()


def test_size_and_place_do_not_matter() -> None:
    vector = ensemble_of_shape_functions(disc())
    moved = ensemble_of_shape_functions(disc() * 0.25 + [3.0, -2.0, 5.0])
    assert np.abs(moved - vector).sum() < 1e-3


def test_attitude_hardly_matters() -> None:
    vector = ensemble_of_shape_functions(sphere())
    turned = ensemble_of_shape_functions(sphere() @ rotation(3).T)
    other = ensemble_of_shape_functions(disc())
    assert np.abs(turned - vector).sum() < 0.2 * np.abs(other - vector).sum()


def test_every_line_on_a_disc_runs_along_it() -> None:
    inside, outside, mixed = histograms(disc())[6:9].sum(axis=1)
    assert inside > 0
    assert outside + mixed < 1e-3 * inside


def test_no_long_line_through_a_hollow_sphere_runs_along_it() -> None:
    inside, outside, mixed = histograms(sphere())[6:9]
    assert inside[BINS // 2 :].sum() == 0
    assert outside.sum() + mixed.sum() > inside.sum()


def test_chords_of_a_sphere_are_distributed_as_their_square() -> None:
    lengths = histograms(sphere())[6:9].sum(axis=0)
    borders = np.arange(1, BINS + 1) / BINS
    assert lengths.cumsum() / lengths.sum() == pytest.approx(borders**2, abs=0.03)


def test_angles_of_a_triangle_weigh_as_the_lines_they_face() -> None:
    # On a circle the angle that faces a chord is uniform and the chord is its sine: the folded weights are sin x.
    azimuth = np.random.default_rng(4).uniform(0, 2 * np.pi, POINTS)
    circle = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(POINTS)], axis=1)
    angles = histograms(circle)[:3].sum(axis=0)
    share = angles.cumsum() / angles.sum()
    borders = np.arange(1, BINS + 1) / BINS * np.pi / 2
    found = np.abs(share - (1 - np.cos(borders))).max()
    uniform = np.abs(share - borders / (np.pi / 2)).max()
    assert found < uniform


def test_the_smallest_cloud_has_a_vector() -> None:
    vector = ensemble_of_shape_functions(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]))
    assert vector.sum() == pytest.approx(1)
