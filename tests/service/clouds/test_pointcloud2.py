"""PointCloud2 in CDR, as other programs write it: byte orders, layouts, and messages that contradict themselves."""

from __future__ import annotations

import time
import tracemalloc
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.clouds import read
from service.clouds.pointcloud2 import Origin, read_origin, read_with_origin
from service.engine.errors import EmptyCloud, ShapeConceptsError, UnreadableCloud
from tests.service.clouds.written import ROS, pointcloud2, some_points

POINTS = some_points()
NAME = "sensor_msgs/msg/PointCloud2"


@pytest.mark.parametrize("little", [True, False])
@pytest.mark.parametrize("kind", ["<f4", ">f4", "<f8", ">f8"])
def test_any_byte_order_of_message_and_coordinates_is_read(little: bool, kind: str):
    data = pointcloud2(POINTS, little=little, kind=kind)
    assert np.array_equal(read(data).points, POINTS)
    assert np.array_equal(read(data, "pointcloud2").points, POINTS)


def test_an_organised_cloud_gives_its_points_row_after_row_with_the_gaps_between_rows_left_out():
    holed = POINTS.copy()
    holed[::3] = np.nan
    rows = np.zeros((10, 20 * 28 + 12), np.uint8)
    message = ROS.deserialize_cdr(pointcloud2(holed.reshape(10, 20, 3)), NAME)
    rows[:, : 20 * 28] = message.data.reshape(10, -1)
    padded = replace(message, row_step=rows.shape[1], data=rows.ravel())
    for sent in (message, padded):
        cloud = read(bytes(ROS.serialize_cdr(sent, NAME)))
        assert np.array_equal(cloud.points, np.delete(POINTS, np.s_[::3], axis=0))
        assert cloud.measured is not None
        assert np.array_equal(np.flatnonzero(~cloud.measured), np.arange(0, 200, 3))


def test_where_and_when_it_was_measured_is_told_beside_the_cloud():
    cloud, origin = read_with_origin(pointcloud2(POINTS), 1000)
    assert origin == Origin("lidar", 1_700_000_000_000_000_005)
    assert origin == read_origin(pointcloud2(POINTS, little=False))
    assert np.array_equal(cloud.xyz, POINTS)


def test_a_frame_without_a_name_is_one_as_well():
    message = ROS.deserialize_cdr(pointcloud2(POINTS), NAME)
    unnamed = bytes(ROS.serialize_cdr(replace(message, header=replace(message.header, frame_id="")), NAME))
    assert read_with_origin(unnamed, 1000)[1].frame_id == ""
    assert np.array_equal(read(unnamed).points, POINTS)


def fields(**changed: Any) -> list[Any]:
    """The fields of a message, with the x of them changed."""
    listed = ROS.deserialize_cdr(pointcloud2(POINTS), NAME).fields
    return [replace(field, **changed) if field.name == "x" else field for field in listed]


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"row_step": 1}, "row_step"),
        ({"width": 201}, "row_step"),
        ({"height": 2}, "promises 11200 bytes of data, but only 5600 follow"),
        ({"data": np.zeros(5599, np.uint8)}, "only 5599 follow"),
        ({"point_step": 0}, "beyond its point_step"),
        ({"point_step": 11}, "beyond its point_step"),
        ({"fields": fields(offset=2**32 - 1)}, "beyond its point_step"),
        ({"fields": fields(offset=25)}, "beyond its point_step"),
        ({"fields": fields(datatype=5)}, "FLOAT32"),
        ({"fields": fields(datatype=200)}, "FLOAT32"),
        ({"fields": fields(count=3)}, "3 values"),
        ({"fields": fields(name="X")}, "none of its fields"),
        ({"fields": []}, "none of its fields"),
        ({"fields": fields() * 100}, "500 fields"),
    ],
)
def test_a_message_that_contradicts_itself_is_refused_with_the_reason(changed: dict[str, Any], said: str):
    with pytest.raises(UnreadableCloud, match=said):
        read(pointcloud2(POINTS, **changed), "pointcloud2")


@pytest.mark.parametrize("changed", [{"width": 0}, {"height": 0}])
def test_a_message_without_points_is_empty(changed: dict[str, int]):
    with pytest.raises(EmptyCloud):
        read(pointcloud2(POINTS, **changed))


def test_another_message_is_refused():
    image = ROS.types["sensor_msgs/msg/Image"](
        ROS.deserialize_cdr(pointcloud2(POINTS), NAME).header, 2, 3, "mono8", 0, 3, np.zeros(6, np.uint8)
    )
    data = bytes(ROS.serialize_cdr(image, "sensor_msgs/msg/Image"))
    with pytest.raises(UnreadableCloud, match="another message"):
        read(data, "pointcloud2")


def test_millions_of_fields_are_not_read():
    head = pointcloud2(POINTS, fields=[])[:36]
    field = b"\x02\x00\x00\x00x\x00\x00\x00" + bytes(12)
    data = head[:32] + (10**6).to_bytes(4, "little") + field * 10**6
    tracemalloc.start()
    begin = time.perf_counter()
    with pytest.raises(UnreadableCloud, match="1000000 fields"):
        read(data, "pointcloud2")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1 << 20
    assert time.perf_counter() - begin < 1


@settings(max_examples=1000, deadline=None, derandomize=True)
@given(
    little=st.booleans(),
    words=st.lists(st.tuples(st.integers(0, 60), st.integers(0, 2**32 - 1) | st.integers(0, 300)), max_size=4),
)
def test_any_number_in_the_head_gives_a_cloud_or_a_refusal(little: bool, words: list[tuple[int, int]]):
    data = bytearray(pointcloud2(some_points(12), little=little))
    for place, number in words:
        data[4 * place : 4 * place + 4] = number.to_bytes(4, "little" if little else "big")
    try:
        cloud = read(bytes(data), "pointcloud2", max_points=10_000)
    except ShapeConceptsError as error:
        said = str(error)
        assert 20 < len(said) < 1000
    else:
        assert np.isfinite(cloud.points).all()
