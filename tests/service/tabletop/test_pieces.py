"""Pieces are what is connected; boxes are the least that hold them."""

from __future__ import annotations

import numpy as np
import pytest

from service.tabletop.pieces import connect, stand_box
from service.tabletop.records import Plane
from tests.shapes import rotation

GROUND = Plane(np.array([0.0, 0.0, 1.0]), 1.0, 0.005)


def test_pieces_are_the_points_less_than_a_gap_apart() -> None:
    line = np.arange(0, 1, 0.01)
    points = np.stack([np.where(line < 0.5, line, line + 0.1), 0 * line, 0 * line], axis=1)
    order = np.random.default_rng(0).permutation(len(points))
    one, other = connect(points[order], 0.011)
    assert {tuple(sorted(order[part])) for part in (one, other)} == {tuple(range(50)), tuple(range(50, 100))}
    assert len(connect(points, 0.2)) == 1
    assert len(connect(points, 0.001)) == len(points)
    assert connect(np.zeros((0, 3)), 0.1) == []


@pytest.mark.parametrize("seed", range(3))
def test_the_box_of_a_turned_block_is_the_block(seed: int) -> None:
    size = np.array([0.3, 0.2, 0.1])
    corners = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3), axis=-1).reshape(-1, 3) * size
    angle = np.random.default_rng(seed).uniform(0, np.pi)
    about_up = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    turn, middle = rotation(seed), np.array([1.0, 2.0, 3.0])
    plane = Plane(turn[:, 2], 0.0, 0.005)
    box = stand_box(corners @ about_up.T @ turn.T + middle, plane)
    np.testing.assert_allclose(box.size, size, atol=1e-9)
    np.testing.assert_allclose(box.centre, middle, atol=1e-9)
    np.testing.assert_allclose(np.abs(box.axes[0] @ turn @ about_up), [1, 0, 0], atol=1e-6)


@pytest.mark.parametrize("points", [np.zeros((1, 3)), np.zeros((9, 3)), np.outer(np.linspace(0, 1, 9), [3, 4, 0])])
def test_what_has_no_extent_has_a_flat_box(points: np.ndarray) -> None:
    box = stand_box(points, GROUND)
    assert box.size == pytest.approx([np.linalg.norm(np.ptp(points, axis=0)), 0, 0], abs=1e-9)
