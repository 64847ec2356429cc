"""The topological space as a model holds it."""

from __future__ import annotations

import numpy as np

from service.engine.space import TopologicalSpace


def test_a_vertex_is_as_hot_as_its_mean_geodesic_distance_to_all():
    path = TopologicalSpace(np.array([[0, 1], [1, 2]]), np.array([0.1, 0.2]), np.array([3, 2, 3]))
    assert np.array_equal(path.vertex_heat, np.array([3, 2, 3]) / 3)
