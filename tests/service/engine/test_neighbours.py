"""Neighbourhoods against brute force."""

from __future__ import annotations

import numpy as np
import pytest

from service.engine.neighbours import neighbourhood, touching


@pytest.mark.parametrize("ordered", [False, True])
@pytest.mark.parametrize("edge", [None, 0.01, 0.1, 2.0])
@pytest.mark.parametrize("count", [1, 2, 80, 500])
def test_all_points_within_the_radius_are_neighbours_and_no_others(count: int, edge: float | None, ordered: bool):
    points = np.random.default_rng(count).random((count, 3)) - 0.5
    if ordered:
        points = points[np.lexsort(points.T)]
    near = neighbourhood(points, 0.3, edge)
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    rows, columns = np.nonzero(distance <= 0.3)
    assert np.array_equal(near.rows, rows)
    assert np.array_equal(near.indices, columns)
    assert np.allclose(near.squared, distance[rows, columns] ** 2, atol=1e-15)


@pytest.mark.parametrize("side", [-np.inf, 0.0, np.inf])
@pytest.mark.parametrize("edge", [0.0371627223, 0.1, 0.3, 1 / 3])
def test_points_on_the_sides_of_columns_have_all_their_neighbours(edge: float, side: float):
    """There a quotient and a product of the same numbers round to either side."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        points = rng.integers(-30, 30, (100, 3)) * edge
        points = np.nextafter(points, side) if side else points
        for radius in (edge, 2.5 * edge, 3 * edge, 4 * edge):
            near = neighbourhood(points, radius, edge)
            x, y, z = ((axis[:, None] - axis) ** 2 for axis in points.T)
            rows, columns = np.nonzero(x + y + z <= radius**2)
            assert np.array_equal(near.rows, rows)
            assert np.array_equal(near.indices, columns)


def test_neighbours_within_less_are_those_of_a_search_within_less():
    points = np.random.default_rng(0).random((200, 3))
    within, searched = neighbourhood(points, 0.4).within(0.2), neighbourhood(points, 0.2)
    assert np.array_equal(within.indptr, searched.indptr)
    assert np.array_equal(within.indices, searched.indices)
    assert np.array_equal(within.squared, searched.squared)


def test_points_that_coincide_are_neighbours():
    near = neighbourhood(np.zeros((3, 3)), 0.1)
    assert near.indices.tolist() == [0, 1, 2] * 3


def test_voxels_touch_by_face_edge_and_corner():
    cells = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 1], [3, 0, 0], [2, 2, 2]], np.int32)
    near = touching(cells)
    pairs = set(zip(near.rows.tolist(), near.indices.tolist(), strict=True))
    expected = {(i, j) for i in range(6) for j in range(6) if np.abs(cells[i] - cells[j]).max() <= 1}
    assert pairs == expected


def test_islands_are_what_touching_leads_to():
    cells = np.array([[0, 0, 0], [5, 0, 0], [1, 1, 1], [6, 1, 0], [9, 9, 9]], np.int32)
    islands = touching(cells).islands()
    assert islands[0] == islands[2] != islands[1] == islands[3]
    assert len(set(islands.tolist())) == 3
