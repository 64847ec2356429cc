"""A scene is answered object by object, in the frame that it was sent in."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from service.application import Application, CloudFile
from service.clouds import SceneCloud, Viewpoint, write_ply
from service.engine.cloud import PointCloud
from service.engine.errors import Cancelled, InvalidParameter, NoSupportingPlane, TooManyPoints
from service.engine.model import ShapeModel
from service.scene_answer import SceneAnswer
from service.settings import Settings
from service.store import ModelStore
from service.tabletop import cut_out, find_objects
from tests.service.clouds.written import pcd
from tests.service.tabletop.seen import AROUND, block, flat, overlaps, set_table, spin_lidar
from tests.shapes import cloud_of


def sent(cloud: PointCloud) -> SceneCloud:
    return SceneCloud(cloud, Viewpoint(), "m", None)


def test_each_object_is_answered_as_its_points_alone_would_be(application: Application, model: ShapeModel) -> None:
    cloud = set_table("kinect").cloud
    scene, answer = find_objects(cloud), application.respond_scene(sent(cloud))
    assert (answer.model, answer.version) == ("tiny", 1)
    assert len(answer.objects) == len(scene.objects) == 3
    for number, (found, told) in enumerate(zip(scene.objects, answer.objects, strict=True)):
        response = model.respond(cut_out(cloud, found, scene.plane))
        assert told.number == number
        assert told.answer is not None
        assert told.answer.responses == response.responses.tolist()
        assert told.error is None
        assert told.points == len(found.indices)
        assert told.position_m == told.sensor_position_m == tuple(found.centroid)
        assert told.box.size_m == tuple(found.box.size)
    assert answer.plane.sensor_height_m == answer.plane.offset_m == scene.plane.offset
    everything = answer.plane.points + sum(one.points for one in [*answer.objects, *answer.left_out])
    assert everything == len(cloud.points)
    assert SceneAnswer.model_validate_json(answer.model_dump_json()) == answer
    assert SceneAnswer.model_validate(json.loads(json.dumps(answer.model_dump()))) == answer


def test_a_cloud_in_a_robots_frame_is_answered_in_that_frame(application: Application) -> None:
    """The robot's base: x forward, y left, z up; the camera a metre above it, looking down to the front."""
    cloud = set_table("kinect").cloud
    pose = Viewpoint((0.2, 0.1, 1.0), (0.3, -0.6, 0.6, -0.42))
    in_base = (cloud.points @ pose.rotation.T + pose.position) * 1000
    data = pcd(in_base.astype(np.float32))
    at_camera = application.respond_scene(sent(cloud))
    at_base = application.respond_scene(
        CloudFile(data, unit="mm", viewpoint=Viewpoint((200, 100, 1000), pose.orientation))
    )
    assert len(at_base.objects) == len(at_camera.objects)
    normal = np.array(at_base.plane.normal)
    np.testing.assert_allclose(normal, pose.rotation @ at_camera.plane.normal, atol=1e-3)
    assert at_base.plane.sensor_height_m == pytest.approx(at_camera.plane.sensor_height_m, abs=1e-3)
    assert normal @ pose.position + at_base.plane.offset_m == pytest.approx(at_base.plane.sensor_height_m)
    for one, other in zip(at_camera.objects, at_base.objects, strict=True):
        place = pose.rotation @ one.position_m + pose.position
        np.testing.assert_allclose(other.position_m, place, atol=0.002)
        np.testing.assert_allclose(other.sensor_position_m, one.sensor_position_m, atol=0.002)
        np.testing.assert_allclose(other.box.axes[2], normal, atol=1e-9)
        up = np.array(other.box.centre_m) @ normal + at_base.plane.offset_m
        assert up == pytest.approx(np.mean(other.height_m), abs=1e-6)


def test_a_lidar_that_sees_all_around_has_its_objects_answered_on_every_side(application: Application) -> None:
    seen = spin_lidar()
    answer = application.respond_scene(sent(seen.cloud))
    assert answer.plane.normal == pytest.approx((0, 0, 1), abs=0.01)
    assert answer.plane.sensor_height_m == pytest.approx(1.0, abs=0.01)
    scene = find_objects(seen.cloud)
    assert min(overlaps(scene, seen.labels)) > 0.9
    assert len(answer.objects) == len(AROUND)
    behind = [one for one in answer.objects if one.position_m[0] < 0]
    assert behind
    for one in answer.objects:
        near = min(AROUND, key=lambda place: np.hypot(place[0] - one.position_m[0], place[1] - one.position_m[1]))
        assert one.position_m[:2] == pytest.approx(near, abs=0.25)
        assert one.answer is not None
        assert one.answer.warnings == []
    facing = np.mean([one.position_m[2] < 0 for one in answer.objects])
    assert facing == 1  # below the sensor, so behind a camera that looks along +z


def test_points_say_which_object_they_are_part_of_in_the_order_of_the_file(application: Application) -> None:
    cloud = set_table("kinect").cloud
    with_holes = np.full((len(cloud.points) * 2, 3), np.nan, np.float32)
    with_holes[::2] = cloud.points
    answer = application.respond_scene(CloudFile(pcd(with_holes)), segments=True)
    assert answer.point_objects is not None
    numbers = np.array(answer.point_objects)
    assert len(numbers) == len(with_holes)
    assert (numbers[1::2] == -1).all()
    for one in answer.objects:
        assert np.count_nonzero(numbers == one.number) == one.points
        assert one.answer is not None
        assert one.answer.point_segments is not None
        assert len(one.answer.point_segments) == one.points
    assert application.respond_scene(sent(cloud)).point_objects is None


def test_an_object_that_reaches_the_border_of_the_image_says_so(application: Application) -> None:
    """A table of 80 x 40 points in rows, with a block in a corner and one in the middle."""
    x, z = np.meshgrid(np.linspace(-0.4, 0.4, 160), np.linspace(1.2, 1.6, 80))
    y = np.full(x.shape, 0.5)
    y[:20, :20] = y[40:60, 80:100] = 0.4
    data = pcd(np.stack([x, y, z], axis=-1).reshape(-1, 3).astype(np.float32), WIDTH=160, HEIGHT=80)
    corner, middle = application.respond_scene(CloudFile(data)).objects
    assert (corner.at_border, middle.at_border) == (True, False)
    (other, _) = application.respond_scene(
        CloudFile(data.replace(b"WIDTH 160\nHEIGHT 80", b"WIDTH 12800\nHEIGHT 1"))
    ).objects
    assert other.at_border is None


class TestWithAnObjectThatTheEngineRefuses:
    @pytest.fixture
    def store(self, store: ModelStore, model: ShapeModel) -> ModelStore:
        """Adds a model that takes objects of 2600 points and more alone."""
        cloud = model.params.cloud.model_copy(update={"min_points": 2600})
        picky = dataclasses.replace(model, params=model.params.model_copy(update={"cloud": cloud}))
        store.publish(picky, name="picky", seed=7, source={"simulated": 8})
        return store

    def test_its_error_is_told_and_the_others_are_answered(self, application: Application) -> None:
        answer = application.respond_scene(sent(set_table("kinect").cloud), model="picky")
        refused = [one for one in answer.objects if one.error]
        answered = [one for one in answer.objects if one.answer]
        assert refused
        assert answered
        assert len(refused) + len(answered) == 3
        for one in refused:
            assert one.error is not None
            assert one.error.type == "too-few-points"
            assert one.answer is None


class TestWithALimitOfObjects:
    @pytest.fixture
    def settings(self, settings: Settings) -> Settings:
        return settings.model_copy(update={"max_objects": 1, "max_points": 100_000})

    def test_only_the_nearest_are_answered(self, application: Application) -> None:
        answer = application.respond_scene(sent(set_table().cloud))
        assert len(answer.objects) == 1
        assert answer.left_out[-1].reason == "many"
        assert answer.left_out[-1].pieces == 2
        with pytest.raises(TooManyPoints):
            application.respond_scene(sent(PointCloud(np.ones((100_001, 3), np.float32))))


def test_a_scene_without_objects_is_an_answer_and_one_without_a_plane_is_not(application: Application) -> None:
    assert application.respond_scene(sent(cloud_of(flat(0.8)))).objects == []
    with pytest.raises(NoSupportingPlane, match="scene=true"):
        application.respond_scene(CloudFile(write_ply(cloud_of(block((0, 0, 1), (0.04, 0.04, 0.04))))))
    with pytest.raises(InvalidParameter):
        application.respond_scene(sent(cloud_of(flat(0.8))), top=0)


def test_a_caller_can_give_up_between_objects(application: Application) -> None:
    told: list[str] = []

    def give_up(stage: str) -> None:
        told.append(stage)
        if told.count("normalise") == 2:
            raise Cancelled("enough")

    with pytest.raises(Cancelled):
        application.respond_scene(sent(set_table().cloud), on_stage=give_up)
    assert told[:2] == ["decode", "tabletop"]
