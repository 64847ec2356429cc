"""Neighbourhoods against brute force."""

from __future__ import annotations

import numpy as np
import pytest

from service.engine.neighbours import neighbourhood, touching


@pytest.mark.parametrize("norm", [2.0, np.inf])
@pytest.mark.parametrize("count", [1, 2, 80])
def test_all_points_within_the_radius_are_neighbours_and_no_others(count: int, norm: float):
    points = np.random.default_rng(count).random((count, 3))
    near = neighbourhood(points, 0.3, norm)
    distance = np.linalg.norm(points[:, None] - points[None], ord=norm, axis=2)
    for i in range(count):
        row = near.indices[near.indptr[i] : near.indptr[i + 1]]
        assert row.tolist() == np.flatnonzero(distance[i] <= 0.3).tolist()
    assert np.array_equal(near.rows, np.nonzero(distance <= 0.3)[0])


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
