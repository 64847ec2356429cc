"""An object is looked at by a camera that is turned to it and upright, wherever it stands around the sensor."""

from __future__ import annotations

import numpy as np
import pytest

from service.tabletop import cut_out, find_objects
from service.tabletop.sight import look_at
from tests.service.tabletop.seen import set_table
from tests.shapes import cloud_of, rotation


@pytest.mark.parametrize("target", [(0, 0, 1), (0, 0, -2), (3, -1, 0), (0, 1, 0), (0, -1, 0)])
def test_the_turned_camera_looks_at_its_target(target: tuple[float, float, float]) -> None:
    up = np.array([0.0, -1.0, 0.0])
    axes = look_at(np.array(target, float), up)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1)
    np.testing.assert_allclose(axes @ target, [0, 0, np.linalg.norm(target)], atol=1e-12)
    assert (axes @ up)[1] <= 1e-12


def test_an_object_is_cut_out_as_the_camera_that_is_turned_to_it_sees_it() -> None:
    seen = set_table()
    for turn in (np.eye(3), rotation(1), np.diag([1.0, -1.0, -1.0])):  # the last one: all is behind the sensor
        cloud = cloud_of(seen.cloud.points @ turn.T)
        scene = find_objects(cloud)
        for one in scene.objects:
            own = cut_out(cloud, one, scene.plane).points
            np.testing.assert_allclose(
                np.linalg.norm(own, axis=1), np.linalg.norm(cloud.points[one.indices], axis=1), rtol=1e-5
            )
            assert own[:, 2].min() > 0
            across = np.linalg.norm(own[:, :2].mean(axis=0))
            assert across < 0.02
            lowest = one.indices[np.argmax(own[:, 1])]  # y is down
            assert scene.plane.heights(cloud.points[[lowest]].astype(float))[0] < 0.02
