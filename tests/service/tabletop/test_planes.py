"""Planes are found among noise and other things, the largest first."""

from __future__ import annotations

import numpy as np
import pytest

from service.tabletop.planes import find_planes
from service.tabletop.records import TabletopParams
from tests.shapes import rotation


def slab(normal: np.ndarray, offset: float, across: float, noise: float, count: int) -> np.ndarray:
    """Points of a square on the plane n.p + d = 0, about where it is nearest to the origin."""
    rng = np.random.default_rng(count)
    basis = np.linalg.svd(normal[None])[2][1:]
    square = rng.uniform(-across / 2, across / 2, (count, 2)) @ basis
    return square + normal * (rng.normal(0, noise, count) - offset)[:, None]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("noise", [0.0, 0.003])
def test_two_planes_among_scattered_points_are_found_the_larger_first(seed: int, noise: float) -> None:
    turn = rotation(seed)
    clutter = np.random.default_rng(seed).uniform(-1, 1, (3000, 3))
    points = np.concatenate([slab(turn[0], 0.8, 1.0, noise, 6000), slab(turn[1], 0.5, 0.7, noise, 3000), clutter])
    first, second, *_ = find_planes(points, 0.005, TabletopParams())
    for plane, normal, offset in ((first, turn[0], 0.8), (second, turn[1], 0.5)):
        assert plane.normal @ normal > np.cos(np.radians(1))
        assert plane.offset == pytest.approx(offset, abs=0.005)
        assert plane.heights(np.zeros((1, 3))) == plane.offset > 0
        assert np.linalg.norm(plane.normal) == pytest.approx(1)
        assert 3 * noise * 0.8 <= plane.band <= max(0.006, 3 * noise * 1.4)
        np.testing.assert_allclose(plane.basis @ plane.basis.T, np.eye(2), atol=1e-12)
        np.testing.assert_allclose(plane.basis @ plane.normal, 0, atol=1e-12)


def test_scattered_points_alone_make_no_plane() -> None:
    points = np.random.default_rng(0).uniform(-1, 1, (20_000, 3))
    assert list(find_planes(points, 0.005, TabletopParams())) == []
    assert list(find_planes(points[:10], 0.005, TabletopParams())) == []
