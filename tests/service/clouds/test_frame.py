"""The sensor's frame: rotations, units, and which points were not measured."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.clouds.frame import RawCloud, Viewpoint, place
from service.engine.errors import ImplausibleExtent, InvalidParameter, NoFinitePoints
from tests.service.clouds.written import some_points

POINTS = some_points().astype(np.float64)
numbers = st.floats(-5, 5)
poses = st.builds(
    Viewpoint,
    st.tuples(numbers, numbers, numbers),
    st.tuples(numbers, numbers, numbers, numbers).filter(lambda q: np.linalg.norm(q) > 0.1),
)


@settings(deadline=None, derandomize=True)
@given(poses)
def test_a_viewpoint_is_a_rotation(pose: Viewpoint):
    assert np.allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-12)
    assert np.isclose(np.linalg.det(pose.rotation), 1)


@settings(deadline=None, derandomize=True)
@given(poses)
def test_placing_undoes_the_sensors_pose(pose: Viewpoint):
    world = POINTS @ pose.rotation.T + pose.position
    assert np.allclose(place(RawCloud(world, pose), "m", None).points, POINTS, atol=1e-6)


def test_a_quarter_turn_about_z_turns_x_into_y():
    half = np.sqrt(0.5)
    assert np.allclose(Viewpoint(orientation=(half, 0, 0, half)).rotation @ [1, 0, 0], [0, 1, 0])


def test_the_length_of_a_quaternion_does_not_matter():
    a, b = Viewpoint(orientation=(0.1, 0.2, 0.3, 0.4)), Viewpoint(orientation=(1, 2, 3, 4))
    assert np.allclose(a.rotation, b.rotation)


def test_points_in_another_order_get_the_same_bits():
    pose = Viewpoint((0.1, 0.2, 0.3), (0.7, 0.1, 0.5, -0.2))
    for seed in range(5):
        order = np.random.default_rng(seed).permutation(len(POINTS))
        moved = place(RawCloud(POINTS[order], pose), "cm", None).points
        assert np.array_equal(moved, place(RawCloud(POINTS, pose), "cm", None).points[order])


def test_the_position_is_in_the_unit_of_the_cloud():
    cloud = place(RawCloud(POINTS * 1000, Viewpoint((0, 0, 500))), "mm", None)
    assert np.allclose(cloud.points, POINTS - [0, 0, 0.5], atol=1e-6)


@pytest.mark.parametrize(
    ("position", "orientation"),
    [
        ((0, 0), (1, 0, 0, 0)),
        ((0, 0, np.nan), (1, 0, 0, 0)),
        ((0, 0, 0), (1, 0, 0)),
        ((0, 0, 0), (0, 0, 0, 0)),
        ((0, 0, 0), (np.inf, 0, 0, 0)),
        ("abc", (1, 0, 0, 0)),
        (None, (1, 0, 0, 0)),
        ((0, 0, 10**400), (1, 0, 0, 0)),
    ],
)
def test_a_pose_that_is_none_is_refused(position, orientation):
    with pytest.raises(InvalidParameter, match="viewpoint"):
        Viewpoint(position, orientation)


def placed(*rows: tuple[float, float, float], pose: Viewpoint | None = None) -> list[list[float]]:
    return place(RawCloud(np.array(rows, float), pose), "m", None).points.tolist()


def test_zeros_at_the_sensor_are_missing_returns():
    assert placed((0, 0, 0), (1, 1, 1), (-0.0, 0, 0)) == [[1, 1, 1]]
    assert placed((0, 0, 0), (0, 0, 1)) == [[0, 0, 1]]


def test_points_with_one_coordinate_of_zero_stay():
    assert len(placed((0, 0, 1), (0, 1, 0), (1, 0, 0), (0, 0.5, 0.5))) == 4


def test_points_at_the_position_of_the_sensor_are_missing_returns():
    position = (0.1, 0.2, 0.3)
    rounded = tuple(np.float32(position).tolist())
    assert np.allclose(placed(rounded, (1, 1, 1), pose=Viewpoint(position)), [[0.9, 0.8, 0.7]])


def test_a_single_zero_away_from_the_sensor_may_be_measured_and_stays():
    assert len(placed((0, 0, 0), (1, 1, 1), pose=Viewpoint((0, 0, -2)))) == 2


def test_zeros_that_repeat_are_missing_returns_wherever_the_sensor_stands():
    assert len(placed((0, 0, 0), (1, 1, 1), (0, 0, 0), pose=Viewpoint((0, 0, -2)))) == 1


def test_a_cloud_of_zeros_holds_no_measurement():
    with pytest.raises(NoFinitePoints, match=r"\(0, 0, 0\) for nothing returned"):
        placed(*[(0, 0, 0)] * 5)


def test_equal_points_elsewhere_are_left_to_the_engine():
    assert len(placed(*[(0.1, 0.2, 0.5)] * 200)) == 200


@pytest.mark.parametrize("value", [1e39, 1e308, -1e39])
def test_coordinates_beyond_float32_are_refused(value: float):
    with pytest.raises(ImplausibleExtent):
        placed((value, 0, 1), (0, 0, 1))
    with pytest.raises(ImplausibleExtent):
        placed((value, 0, 1), (0, 0, 1), pose=Viewpoint((-1e308, 0, 0), (1, 2, 3, 4)))


def test_what_was_not_measured_is_known_by_its_place():
    rows = np.array([[np.nan, 0, 1], [1, 2, 3], [0, 0, 0], [4, 5, 6], [0, 0, 0]], float)
    cloud = place(RawCloud(rows), "m", None)
    assert cloud.measured is not None
    assert cloud.measured.tolist() == [False, True, False, True, False]
    assert np.array_equal(rows[cloud.measured], cloud.points)
    assert place(RawCloud(POINTS), "m", None).measured is None


@settings(deadline=None, derandomize=True, max_examples=200)
@given(
    st.lists(
        st.tuples(*[st.one_of(numbers, st.sampled_from([0.0, np.nan, np.inf, 1e-50, 3.4e38, 1e39]))] * 3),
        min_size=1,
        max_size=6,
    )
)
def test_a_plain_cloud_is_what_it_is_when_every_point_is_looked_at(points: list[tuple[float, float, float]]):
    xyz = np.array(points)

    def placed(viewpoint: Viewpoint | None) -> object:
        try:
            return place(RawCloud(xyz), None, viewpoint)
        except (NoFinitePoints, ImplausibleExtent) as error:
            return type(error)

    quick = placed(None)
    # equal to the origin, but not by its bits: so that each point is looked at
    plain = placed(Viewpoint((0.0, 0.0, 0.0), (2.0, 0.0, 0.0, 0.0)))
    if isinstance(quick, type):
        assert quick is plain
    else:
        assert np.array_equal(quick.points, plain.points)
        assert (quick.measured is None) == (plain.measured is None)
        assert quick.measured is None or np.array_equal(quick.measured, plain.measured)
