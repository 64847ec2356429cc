"""What stands on a plane is found, whatever the order, place and attitude of the cloud, and the rest accounted for."""

from __future__ import annotations

import time

import numpy as np
import pytest
from numpy.typing import NDArray

from service.engine.cloud import PointCloud
from service.engine.errors import InvalidCloud, NoSupportingPlane, TooFewPoints
from service.tabletop import REASONS, Scene, TabletopParams, find_objects
from tests.service.tabletop.seen import PLACES, VIEW, block, flat, overlaps, set_table
from tests.shapes import cloud_of, cube, look, rotation, see, table


def told(scene: Scene) -> tuple[object, ...]:
    """All that is said of a scene but the points' numbers, to the bit."""
    return (
        scene.plane.normal.tobytes(),
        scene.plane.offset,
        scene.inliers,
        [(one.centroid.tobytes(), [part.tobytes() for part in one.box], one.height.tobytes()) for one in scene.objects],
        [(len(one.indices), one.touches, one.at_border, one.beyond_edge) for one in scene.objects],
        scene.left_out,
        scene.warnings,
    )


@pytest.mark.parametrize(("noise", "least"), [("none", 0.95), ("kinect", 0.85)])
def test_the_objects_on_a_table_are_found_where_they_stand(noise: str, least: float) -> None:
    seen = set_table(noise)
    scene = find_objects(seen.cloud)
    assert len(scene.objects) == 3
    assert min(overlaps(scene, seen.labels)) > least
    up = VIEW.pose[:3, :3].T @ [0, 0, 1]
    assert scene.plane.normal @ up > np.cos(np.radians(1))
    assert scene.plane.offset == pytest.approx(VIEW.pose[2, 3], abs=0.005)
    for found in scene.objects:
        number = np.bincount(seen.labels[found.indices]).argmax()
        x, y, _ = VIEW.to_composition(found.box.centre[None])[0]
        assert (x, y) == pytest.approx(PLACES[number], abs=0.02)
        assert found.height[1] == pytest.approx(0.12 if number == 2 else 0.08, abs=0.01)
        assert (found.touches, found.at_border, found.beyond_edge) == ((), None, False)


def test_boxes_are_as_large_as_what_they_hold_and_stand_on_the_plane() -> None:
    scene = find_objects(set_table().cloud)
    cube_found = min(scene.objects, key=lambda one: np.ptp(one.box.size[:2]) + abs(one.box.size[0] - 0.08))
    assert cube_found.box.size == pytest.approx([0.08, 0.08, 0.08], abs=0.006)
    for found in scene.objects:
        np.testing.assert_allclose(found.box.axes @ found.box.axes.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(found.box.axes) == pytest.approx(1)
        np.testing.assert_array_equal(found.box.axes[2], scene.plane.normal)
        assert found.box.size[0] >= found.box.size[1]
        own = (set_table().cloud.points[found.indices] - found.box.centre) @ found.box.axes.T
        assert (np.abs(own) <= found.box.size / 2 + 1e-9).all()


@pytest.mark.parametrize("noise", ["none", "kinect"])
def test_every_point_is_accounted_for_once(noise: str) -> None:
    seen = set_table(noise)
    scene = find_objects(seen.cloud, TabletopParams(reach=1.1))
    parts = [found.indices for found in scene.objects]
    assert len(np.unique(np.concatenate(parts))) == sum(map(len, parts))
    assert sum(map(len, parts)) + scene.inliers + sum(left.points for left in scene.left_out) == len(seen.cloud.points)
    assert {left.reason for left in scene.left_out} <= set(REASONS)
    far = np.count_nonzero(np.linalg.norm(seen.cloud.points, axis=1) > 1.1)
    assert scene.left_out[0][:2] == ("far", far)


def test_points_in_another_order_give_the_same_objects_to_the_bit() -> None:
    cloud = set_table("kinect").cloud
    order = np.random.default_rng(3).permutation(len(cloud.points))
    one, other = find_objects(cloud), find_objects(PointCloud(cloud.points[order]))
    assert told(one) == told(other)
    for a, b in zip(one.objects, other.objects, strict=True):
        np.testing.assert_array_equal(a.indices, np.sort(order[b.indices]))
    assert told(find_objects(cloud)) == told(one)


@pytest.mark.parametrize("seed", range(4))
def test_a_sensor_turned_any_way_sees_the_same_objects(seed: int) -> None:
    seen = set_table("kinect")
    turn = rotation(seed)
    one, other = find_objects(seen.cloud), find_objects(cloud_of(seen.cloud.points @ turn.T))
    assert len(one.objects) == len(other.objects) == 3
    assert min(overlaps(other, seen.labels)) > 0.85
    for a, b in zip(one.objects, other.objects, strict=True):
        np.testing.assert_allclose(turn @ a.centroid, b.centroid, atol=0.003)
        np.testing.assert_allclose(a.box.size, b.box.size, atol=0.012)


@pytest.mark.parametrize(("gap", "objects", "touching"), [(0.0, 1, 0), (0.025, 2, 2), (0.08, 2, 0)])
def test_what_touches_is_one_object_and_what_nearly_does_says_so(gap: float, objects: int, touching: int) -> None:
    apart = (0.06 + gap) / 2
    pair = table((cube(0.06), 0.06, (0, -apart)), (cube(0.06), 0.06, (0, apart)))
    scene = find_objects(see(pair, look(0, 40, 1.0)).cloud)
    assert len(scene.objects) == objects
    assert sum(len(one.touches) for one in scene.objects) == touching


def test_the_supporting_plane_is_the_largest_that_something_stands_on() -> None:
    wall = flat(1.2)[:, [0, 2, 1]] + [0, -1.6, 1.7]  # behind the table, and larger
    on_table = np.concatenate([wall, flat(0.8, 10_000), block((0, 0.45, 1.4), (0.1, 0.1, 0.1))])
    scene = find_objects(cloud_of(on_table))
    assert scene.plane.normal[1] < -0.99
    (found,) = scene.objects
    assert found.box.size == pytest.approx([0.1, 0.1, 0.1], abs=0.02)
    assert {left.reason for left in scene.left_out} == {"high", "beside"}


def test_what_is_not_an_object_on_the_plane_is_left_out_with_its_reason() -> None:
    parts = {
        "object": block((0.2, 0.45, 1.4), (0.1, 0.1, 0.1)),
        "below": block((0, 0.8, 1.5), (0.1, 0.1, 0.1)),
        "beside": block((1.0, 0.4, 1.5), (0.1, 0.1, 0.1)),
        "afloat": block((-0.1, 0.2, 1.5), (0.1, 0.1, 0.1)),
        "small": block((-0.2, 0.485, 1.3), (0.01, 0.01, 0.01)),
        "high": block((0, -0.7, 1.5), (0.1, 0.1, 0.1)),
        "far": block((0, 0.4, 30), (0.1, 0.1, 0.1)),
    }
    scene = find_objects(cloud_of(np.concatenate([flat(0.9), *parts.values()])))
    assert len(scene.objects) == 1
    left = {one.reason: one for one in scene.left_out}
    assert set(left) == set(parts) - {"object"}
    for reason, one in left.items():
        assert one.points == pytest.approx(len(parts[reason]), rel=0.3)
        assert one.pieces == (1 if reason in ("afloat", "small") else 0)
    wide = block((0, 0.35, 1.5), (1.4, 0.3, 0.2), 40_000)
    large = find_objects(cloud_of(np.concatenate([flat(2.0, 100_000), wide])))
    assert [one.reason for one in large.left_out] == ["large"]


def test_an_object_with_another_before_it_says_that_it_may_be_hidden() -> None:
    row = table((cube(0.08), 0.08, (0.12, 0)), (cube(0.08), 0.08, (-0.02, 0.04)), (cube(0.08), 0.08, (-0.1, -0.2)))
    front, back, aside = find_objects(see(row, look(0, 30, 1.0)).cloud).objects
    assert (front.hidden_by, back.hidden_by, aside.hidden_by) == ((), (0,), ())


def test_what_hides_its_own_foot_stands_and_what_hangs_over_ground_that_is_seen_does_not() -> None:
    top = block((0, 0.25, 1.5), (0.3, 0.1, 0.3), 9000)  # 20 cm above the plane
    ground = flat(0.9)
    hidden = (np.abs(ground[:, 0]) < 0.17) & (np.abs(ground[:, 2] - 1.5) < 0.17)
    assert [left.reason for left in find_objects(cloud_of(np.concatenate([ground, top]))).left_out] == ["afloat"]
    (found,) = find_objects(cloud_of(np.concatenate([ground[~hidden], top]))).objects
    assert found.height[0] == pytest.approx(0.2, abs=0.01)


def test_only_as_many_objects_as_were_asked_for_are_kept_and_these_are_the_nearest() -> None:
    cloud = set_table().cloud
    whole, two = find_objects(cloud), find_objects(cloud, most=2)
    distances = [float(np.linalg.norm(one.centroid)) for one in whole.objects]
    assert distances == sorted(distances)
    for a, b in zip(whole.objects, two.objects, strict=False):
        np.testing.assert_array_equal(a.indices, b.indices)
    assert two.left_out[-1] == ("many", len(whole.objects[2].indices), 1)


def test_an_object_that_goes_on_beyond_the_table_says_so() -> None:
    lying = block((0.4, 0.46, 1.5), (0.4, 0.06, 0.06), 12_000)  # half of it over the edge
    (found,) = find_objects(cloud_of(np.concatenate([flat(0.8), lying]))).objects
    assert found.beyond_edge
    (inside,) = find_objects(cloud_of(np.concatenate([flat(0.8), lying - [0.3, 0, 0]]))).objects
    assert not inside.beyond_edge


def test_an_empty_table_is_a_plane_without_objects() -> None:
    scene = find_objects(cloud_of(flat(0.8)))
    assert (scene.objects, scene.left_out, scene.inliers) == ((), (), 20_000)


def test_a_sensor_in_the_plane_is_told_of() -> None:
    moved = np.concatenate([flat(0.8), block((0, 0.45, 1.4), (0.1, 0.1, 0.1))]) - [0, 0.5, 0]
    assert "viewpoint" in find_objects(cloud_of(moved)).warnings[0]


def test_a_sensor_said_to_be_on_the_wrong_side_is_told_of() -> None:
    moved = np.concatenate([flat(0.8), block((0, 0.45, 1.4), (0.1, 0.1, 0.1))]) - [0, 1, 0]
    scene = find_objects(cloud_of(moved))
    assert scene.objects == ()
    assert "viewpoint" in scene.warnings[0]
    assert find_objects(cloud_of(moved + np.array([0, 1, 0]))).warnings == ()


def noise(across: float, distance: float) -> NDArray[np.float64]:
    return np.random.default_rng(0).uniform(-across / 2, across / 2, (30_000, 3)) + np.array([0, 0, distance])


def ball_alone() -> NDArray[np.float64]:
    directions = np.random.default_rng(0).standard_normal((20_000, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True) * 0.3 + [0, 0, 1.5]


@pytest.mark.parametrize(
    ("points", "error"),
    [
        (np.zeros((0, 3)), TooFewPoints),
        (np.ones((99, 3)), TooFewPoints),
        (np.full((500, 3), np.nan), TooFewPoints),
        (np.full((500, 3), 1e30), TooFewPoints),
        (np.ones((5000, 3)), NoSupportingPlane),
        (np.linspace([0, 0, 1], [3, 0, 1], 5000), NoSupportingPlane),
        (noise(1.0, 1.5), NoSupportingPlane),
        (noise(0.1, 0.5), NoSupportingPlane),
        (ball_alone(), NoSupportingPlane),
    ],
    ids=["empty", "few", "nothing measured", "beyond all reach", "one place", "line", "noise", "blob", "ball"],
)
def test_what_has_no_plane_is_refused_with_advice(points: NDArray[np.float64], error: type[InvalidCloud]) -> None:
    with pytest.raises(error, match=r"Send|Check"):
        find_objects(cloud_of(points))


def test_time_is_bounded_for_a_scene_that_is_nothing_but_blobs() -> None:
    rng = np.random.default_rng(0)
    blobs = rng.uniform([-1, -0.4, 0.5], [1, 0.4, 2.5], (2000, 1, 3)) + rng.normal(0, 0.006, (2000, 250, 3))
    began = time.perf_counter()
    scene = find_objects(cloud_of(np.concatenate([flat(2.0, 500_000), blobs.reshape(-1, 3)])), most=5)
    assert time.perf_counter() - began < 20
    assert len(scene.objects) <= 5
