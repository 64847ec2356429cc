"""What is drawn of a cloud; pictures and labels are asked for over HTTP, in transports/rest/test_objects.py."""

from __future__ import annotations

import numpy as np
import pytest

from service.application import Application, CloudFile
from service.clouds import SceneCloud, Viewpoint
from service.engine.cloud import PointCloud
from service.engine.errors import InvalidParameter, TooFewPoints, UnreadableCloud
from service.engine.model import ShapeModel
from service.looking import Drawing, draw
from tests.service.tabletop.seen import set_table


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


@pytest.mark.parametrize("scene", [False, True])
@pytest.mark.parametrize("missing", [0, 7])
def test_an_answer_tells_the_parts_of_what_is_drawn_alone_as_it_would_tell_them_of_all(
    application: Application, clouds: list[PointCloud], scene: bool, missing: int
) -> None:
    points = (set_table("kinect").cloud if scene else clouds[0]).points
    lacking = np.r_[np.zeros(missing, bool), np.ones(len(points), bool)]
    sent = SceneCloud(PointCloud(points, lacking if missing else None))
    drawing = Drawing(300)
    if scene:
        all_parts = application.respond_scene(sent, segments=True).point_objects
        parts = application.respond_scene(sent, drawing=drawing).point_objects
    else:
        all_parts = application.respond(sent.cloud, segments=True).point_segments
        parts = application.respond(sent.cloud, drawing=drawing).point_segments
    assert drawing.drawn is not None
    assert all_parts is not None
    assert len(set(all_parts)) > 1
    assert parts == [all_parts[place] for place in drawing.drawn.places]
    assert len(parts) == len(drawing.drawn.points) == 300


def test_nothing_is_drawn_of_a_cloud_that_cannot_be_read_and_a_small_one_is_drawn_whole(
    application: Application,
) -> None:
    unread, small = Drawing(300), Drawing(300)
    with pytest.raises(UnreadableCloud):
        application.respond(CloudFile(b"ply\n"), drawing=unread)
    with pytest.raises(TooFewPoints):
        application.respond(CloudFile(b"0 0 1\n0 0.1 1\n"), drawing=small)
    assert unread.drawn is None
    assert small.drawn is not None
    assert len(small.drawn.points) == 2


def test_training_objects_have_thumbnails_by_number(application: Application, model: ShapeModel) -> None:
    assert np.array_equal(application.looking.thumbnail("tiny", 1, 7), model.prototypes.thumbnails[7])
    for wrong in (-1, 8):
        with pytest.raises(InvalidParameter, match="8 objects"):
            application.looking.thumbnail("tiny", 1, wrong)
