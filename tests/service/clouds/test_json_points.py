"""JSON points: what is read of them, and what hostile JSON may not do."""

from __future__ import annotations

import json
import time
import tracemalloc
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.clouds import Viewpoint, read
from service.clouds.json_points import PIECE, _parse_any, _parse_plain
from service.engine.errors import EmptyCloud, ImplausibleExtent, ShapeConceptsError, TooManyPoints, UnreadableCloud
from tests.service.clouds.written import json_points, some_points

POINTS = some_points()
LISTED = json_points(POINTS)


def said(document: Any) -> bytes:
    return json.dumps(document).encode()


@pytest.mark.parametrize("indent", [None, 0, 3])
def test_members_may_come_in_any_order_and_with_any_blanks(indent: int | None):
    for names in (["points", "unit", "viewpoint"], ["viewpoint", "points", "unit"], ["points"]):
        whole = {"points": LISTED, "unit": "m", "viewpoint": [0, 0, 0]}
        text = json.dumps({name: whole[name] for name in names}, indent=indent)
        assert np.array_equal(read(f"\ufeff \r\n\t{text}\n ".encode()).points, POINTS)


def test_the_files_own_unit_and_viewpoint_hold_unless_the_caller_states_others():
    pose = Viewpoint((30, -20, 10), (0.9, 0.1, -0.3, 0.2))
    document = {"points": LISTED, "unit": "cm", "viewpoint": [*pose.position, *pose.orientation]}
    assert np.allclose(read(said(document)).points, (POINTS.astype(float) - pose.position) @ pose.rotation / 100)
    assert np.array_equal(read(said(document), unit="m", viewpoint=Viewpoint()).points, POINTS)
    assert np.array_equal(read(said(document | {"unit": None, "viewpoint": None})).points, POINTS)


def test_null_for_a_point_or_a_coordinate_is_what_was_not_measured():
    holed = [None, *LISTED[:7], [None] * 3, *LISTED[7:11], [0.1, None, 0.7], *LISTED[11:], None]
    cloud = read(said(holed))
    assert np.array_equal(cloud.points, POINTS)
    assert cloud.measured is not None
    assert np.flatnonzero(~cloud.measured).tolist() == [0, 8, 13, 203]


def test_a_cloud_of_many_pieces_is_read_whole():
    count = 2 * PIECE // 40
    many = some_points(count)
    text = said({"points": [None] * PIECE + json_points(many)}).replace(b"null, null", b"null,   null")
    assert len(text) > 5 * PIECE
    assert np.array_equal(read(text).points, many)


@pytest.mark.parametrize("row", [b"[0.1,0.2,0.3]", b"[ null , null , null ]", b"[0.1,\n  0.2,\n  0.3\n]"])
def test_a_piece_may_end_anywhere_within_a_point(row: bytes):
    nulls = PIECE // 5 - 20
    for shift in range(len(row) + 120):
        text = b"[" + b" " * shift + b"null," * nulls + row + b"," + b"null," * nulls + b"[1,2,3]]"
        cloud = read(text)
        expected = [nulls, 2 * nulls + 1] if b"0" in row else [2 * nulls + 1]
        assert np.flatnonzero(cloud.measured).tolist() == expected


REFUSED: dict[str, tuple[bytes, str]] = {
    "nested lists": (b"[" * 100_000, "should be a part of a list of points"),
    "nested objects": (b'{"points":' * 100_000, "should be a list of points"),
    "a nested viewpoint": (b'{"viewpoint":' + b"[" * 100_000, "should be the value of 'viewpoint'"),
    "NaN": (b"[[NaN, 1, 2]]", "null where nothing was measured"),
    "-Infinity": (b"[[0, -Infinity, 2]]", "null where nothing was measured"),
    "a number beyond floats": (b"[[1e999, 1, 2]]", "a number beyond any"),
    "a number of many digits": (b"[[" + b"9" * 5_000 + b", 1, 2]]", "a number beyond any"),
    "a number of more digits": (b"[[" + b"9" * 2_000_000 + b", 1, 2]]", "should be a point in less than"),
    "two coordinates": (b"[[0, 1, 2], [1, 2]]", "point 1, counted from 0, is \\[1.0, 2.0\\]"),
    "four coordinates": (b"[[1, 2, 3, 4]]", "point 0"),
    "flat numbers": (b"[1, 2, 3]", "point 0"),
    "text for a number": (b'[["1", 2, 3]]', "should be a part of a list of points"),
    "true for a number": (b"[[true, 2, 3]]", "should be a part of a list of points"),
    "points as objects": (b'[{"x": 1, "y": 2, "z": 3}]', "should be a part of a list of points"),
    "a hexadecimal number": (b"[[0x1, 2, 3]]", "should be a part of a list of points"),
    "a leading zero": (b"[[01, 2, 3]]", "Expecting ',' delimiter"),
    "a wrong null": (b"[[nul, 2, 3]]", "Expecting value"),
    "a comma too many": (b"[[1, 2, 3],]", "Expecting value|Illegal trailing comma"),
    "a comma for a point": (b"[[1, 2, 3],,[1, 2, 3]]", "Expecting value"),
    "a comma too few": (b"[[1, 2, 3] [1, 2, 3]]", "Expecting ',' delimiter"),
    "an end too early": (b"[[1, 2, 3], [1, 2", "truncated"),
    "an end before the points": (b'{"points": ', "truncated"),
    "an end after the points": (b'{"points": [[1, 2, 3]]', "truncated"),
    "no points": (b'{"unit": "m"}', "no member 'points'"),
    "an unknown member": (b'{"colours": [], "points": []}', "unknown; there are points, unit, viewpoint"),
    "a member twice": (b'{"points": [[1, 2, 3]], "points": [[1, 2, 3]]}', "twice"),
    "an unknown unit": (b'{"unit": "mile", "points": [[1, 2, 3]]}', "mm"),
    "a list for a unit": (b'{"unit": [1, 2], "points": [[1, 2, 3]]}', "is unknown"),
    "half a viewpoint": (b'{"viewpoint": [1, 2], "points": [[1, 2, 3]]}', "qw"),
    "a viewpoint without rotation": (b'{"viewpoint": [1, 2, 3, 0, 0, 0, 0], "points": [[1, 2, 3]]}', "not zero"),
    "a viewpoint in words": (b'{"viewpoint": "here", "points": [[1, 2, 3]]}', "qw"),
    "blanks for a point": (b"[" + b" " * 2 * PIECE + b"[1, 2, 3]]", "should be a point in less than"),
    "two clouds": (b"[[1, 2, 3]] [[1, 2, 3]]", "follows its end"),
    "no comma between members": (b'{"points": [[1, 2, 3]] "unit": "m"}', "should be a comma"),
    "a comma after the last member": (b'{"points": [[1, 2, 3]], }', "should be one of the members"),
    "another text": (b'"points"', "should be a list or an object"),
    "UTF-16": ("[[1, 2, 3]]".encode("utf-16"), "should be a list or an object"),
    "no more than blanks": (b"   ", "truncated"),
}  # fmt: skip


@pytest.mark.parametrize("hostile", REFUSED)
def test_json_that_is_no_cloud_is_refused_with_the_reason_and_at_once(hostile: str):
    read(said(LISTED))  # compiled beforehand
    data, reason = REFUSED[hostile]
    tracemalloc.start()
    begin = time.perf_counter()
    with pytest.raises(UnreadableCloud, match=reason) as refused:
        read(data, "json")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(str(refused.value)) < 500
    assert peak < 2 * len(data) + (4 << 20)
    assert time.perf_counter() - begin < 2


def test_the_points_are_counted_before_they_are_read():
    for data in (b"[" + b"[]," * 3_000_000 + b"[]]", b"[" + b"null," * 3_000_000 + b"null]"):
        tracemalloc.start()
        with pytest.raises(TooManyPoints, match="3000001 points"):
            read(data, "json", max_points=1_000_000)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 1 << 20


def test_a_list_at_the_limit_takes_little_memory_beside_its_points():
    data = b"[" + b"[0.1,0.2,0.3]," * 299_999 + b"[0.1,0.2,0.3]]"
    tracemalloc.start()
    assert len(read(data).points) == 300_000
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 4 * 300_000 * 24


def test_huge_coordinates_are_beyond_any_sensor():
    with pytest.raises(ImplausibleExtent):
        read(b"[[1e300, 1, 2], [1, 2, 3]]")


@pytest.mark.parametrize("data", [b"[]", b"[ ]", b'{"points": []}'])
def test_a_list_without_points_is_empty(data: bytes):
    with pytest.raises(EmptyCloud):
        read(data)


JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers(-(10**400), 10**400) | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.sampled_from(["points", "unit", "viewpoint", "x"]), inner, max_size=3)
    ),
    max_leaves=12,
)


@settings(max_examples=500, deadline=None, derandomize=True)
@given(document=JSON | st.fixed_dictionaries({"points": JSON | st.just([[1, 2, 3]]), "unit": JSON, "viewpoint": JSON}))
def test_any_json_is_a_cloud_or_refused(document: Any):
    try:
        read(json.dumps(document).encode(), "json")
    except ShapeConceptsError as error:
        said_of_it = str(error)
        assert 20 < len(said_of_it) < 1000


numbers_or_null = st.one_of(st.floats(allow_nan=False, allow_infinity=False), st.integers(-(2**70), 2**70), st.none())


@settings(deadline=None, derandomize=True, max_examples=200)
@given(st.lists(st.one_of(st.none(), st.lists(numbers_or_null, min_size=2, max_size=4)), min_size=1, max_size=5))
def test_points_that_are_read_in_half_the_time_are_the_same(points: list[Any]):
    text = said(points)[1:-1]
    quick = _parse_plain(text)
    if quick is None:
        assert any(point is None or len(point) != 3 for point in points)
    else:
        assert np.array_equal(quick, _parse_any(text, 0), equal_nan=True)
