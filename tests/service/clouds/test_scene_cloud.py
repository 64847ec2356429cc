"""A cloud that is read as a scene keeps the pose of its sensor and the width of its image."""

from __future__ import annotations

import numpy as np
import pytest

from service.clouds import Viewpoint, read, read_scene
from tests.service.clouds.written import pcd, rows_of, some_points


def test_places_go_back_to_the_frame_that_the_cloud_was_sent_in() -> None:
    points = some_points()
    pose = Viewpoint((0.1, -0.4, 0.3), (0.5, -0.5, 0.5, -0.5))
    for unit, metres in (("m", 1.0), ("mm", 0.001)):
        sent = read_scene(rows_of(points), unit=unit, viewpoint=pose)
        np.testing.assert_array_equal(sent.cloud.points, read(rows_of(points), unit=unit, viewpoint=pose).points)
        for own, sensor in zip(points[:20] * metres, sent.cloud.points[:20], strict=True):
            np.testing.assert_allclose(sent.to_own_frame(sensor.astype(float)), own, atol=1e-6 * metres)


def test_the_files_own_viewpoint_counts_and_a_given_one_overrides_it() -> None:
    data = pcd(some_points(), VIEWPOINT="1 2 3 1 0 0 0")
    assert read_scene(data).pose == Viewpoint((1, 2, 3))
    assert read_scene(data, viewpoint=Viewpoint((4, 5, 6))).pose == Viewpoint((4, 5, 6))
    assert read_scene(rows_of(some_points())).pose == Viewpoint()


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
def test_an_organised_pcd_has_the_width_of_its_rows(encoding: str) -> None:
    points = some_points(200)
    assert read_scene(pcd(points, encoding, WIDTH=20, HEIGHT=10)).width == 20
    assert read_scene(pcd(points, encoding)).width is None
    assert read_scene(pcd(points, encoding, WIDTH=None, HEIGHT=None)).width is None
