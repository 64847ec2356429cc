"""What is drawn of a cloud; pictures and labels are asked for over HTTP, in transports/rest/test_objects.py."""

from __future__ import annotations

import numpy as np
import pytest

from service.clouds import SceneCloud, Viewpoint
from service.engine.cloud import PointCloud
from service.looking import draw


def cloud(count: int, measured: np.ndarray | None = None) -> SceneCloud:
    points = np.random.default_rng(3).uniform(-1, 1, (count, 3)).astype(np.float32)
    return SceneCloud(PointCloud(points, measured))


@pytest.mark.parametrize(("count", "most"), [(1, 1), (50, 100), (100, 100), (1000, 100), (1000, 1)])
def test_as_many_points_as_there_are_or_may_be_are_drawn_each_once(count: int, most: int) -> None:
    sent = cloud(count)
    drawn = draw(sent, most)
    assert len(drawn.points) == len(set(drawn.places.tolist())) == min(count, most)
    assert np.array_equal(drawn.points, sent.cloud.points[drawn.places])
    assert (drawn.measured, drawn.in_file) == (count, count)


def test_the_same_cloud_is_drawn_the_same_and_fewer_points_are_the_first_of_more() -> None:
    sent = cloud(1000)
    many, again, few = draw(sent, 500), draw(sent, 500), draw(sent, 50)
    assert np.array_equal(many.places, again.places)
    assert np.array_equal(many.places[:50], few.places)


def test_places_count_what_was_not_measured() -> None:
    measured = np.random.default_rng(1).random(400) < 0.5
    drawn = draw(cloud(int(measured.sum()), measured))
    assert sorted(drawn.places) == np.flatnonzero(measured).tolist()
    assert (drawn.measured, drawn.in_file) == (measured.sum(), 400)


def test_the_pose_of_the_sensor_is_told_in_metres() -> None:
    sent = cloud(5)._replace(pose=Viewpoint((100, 0, -50), (0, 1, 0, 0)), unit="cm")
    assert draw(sent).viewpoint == pytest.approx((1, 0, -0.5, 0, 1, 0, 0))
