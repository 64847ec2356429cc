"""Nested boxes hold their points and nothing else, and are as far as they say."""

from __future__ import annotations

import numpy as np
import pytest

from worker.learning.boxes import LEAF, boxes, of_one, squared_from


def points(size: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((size, 3)) * [1, 5, 0.1]


@pytest.mark.parametrize("size", [1, 2, LEAF, LEAF + 1, 100, 1000])
def test_each_box_holds_its_points_and_its_halves_hold_the_same(size: int):
    given = points(size)
    found = boxes(given)
    assert sorted(found.vertex.tolist()) == list(range(size))
    assert np.array_equal(found.points, given[found.vertex])
    for t, (start, stop) in enumerate(zip(found.start.tolist(), found.stop.tolist(), strict=True)):
        own = found.points[start:stop]
        assert np.array_equal(own.min(axis=0), found.low[t])
        assert np.array_equal(own.max(axis=0), found.high[t])
        if 2 * t + 2 < len(found.start):
            assert (found.start[2 * t + 1], found.stop[2 * t + 2]) == (start, stop)
            assert found.stop[2 * t + 1] == found.start[2 * t + 2]
        else:
            assert 1 <= stop - start <= LEAF


def test_a_box_is_no_farther_than_any_point_in_it():
    found, asked = boxes(points(300)), points(20, seed=1)
    for point in asked:
        for t in range(len(found.start)):
            own = found.points[found.start[t] : found.stop[t]]
            nearest = ((own - point) ** 2).sum(axis=1).min()
            assert squared_from(found.low, found.high, t, point) <= nearest + 1e-12


def test_boxes_of_equal_points_have_no_extent():
    found = boxes(np.ones((50, 2)))
    assert np.array_equal(found.low, found.high)
    assert squared_from(found.low, found.high, 0, np.array([1.0, 3.0])) == 4


def test_a_box_is_of_a_component_if_all_its_points_are():
    found = boxes(points(200))
    component = np.random.default_rng(2).integers(3, size=200)
    component[found.start[5] : found.stop[5]] = 1
    told = of_one(component, found.start, found.stop)
    for t in range(len(told)):
        kinds = np.unique(component[found.start[t] : found.stop[t]])
        assert told[t] == (kinds[0] if len(kinds) == 1 else -1)
