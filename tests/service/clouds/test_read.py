"""Laws that hold for every format: `read` as its callers see it."""

from __future__ import annotations

import subprocess
import sys
import time
import tracemalloc
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.clouds import FORMATS, Viewpoint, read, write_ply
from service.engine.cloud import PointCloud
from service.engine.errors import (
    EmptyCloud,
    ImplausibleExtent,
    InvalidParameter,
    NoFinitePoints,
    ShapeConceptsError,
    TooManyPoints,
    UnreadableCloud,
    UnsupportedFormat,
)
from tests.service.clouds.written import (
    every_kind,
    npy_header,
    npz,
    pcd,
    pcd_header,
    ply_header,
    pointcloud2,
    rows_of,
    some_points,
)

POINTS = some_points()
KINDS = every_kind(POINTS)
SMALL = every_kind(some_points(12))
kinds = pytest.mark.parametrize("kind", KINDS)


@kinds
def test_every_format_gives_back_the_points_bit_for_bit(kind: str):
    cloud = read(KINDS[kind])
    assert cloud.points.dtype == np.float32
    assert np.array_equal(cloud.points, POINTS)


@kinds
def test_the_format_can_be_stated_and_then_gives_the_same(kind: str):
    assert np.array_equal(read(KINDS[kind], kind.split()[0]).points, POINTS)


@kinds
def test_missing_points_are_dropped_and_the_rest_keeps_its_order(kind: str):
    holed = POINTS.copy()
    holed[3] = np.nan
    holed[7, 1] = np.inf
    holed[11, 2] = np.nan
    cloud = read(every_kind(holed)[kind])
    assert np.array_equal(cloud.points, np.delete(POINTS, [3, 7, 11], axis=0))


@kinds
def test_an_all_nan_cloud_has_no_finite_points(kind: str):
    with pytest.raises(NoFinitePoints, match="none of the 200 points"):
        read(every_kind(np.full_like(POINTS, np.nan))[kind])


@kinds
def test_a_cloud_without_points_is_empty(kind: str):
    name = f"cloud.{kind.split()[0]}"
    with pytest.raises(EmptyCloud):
        read(every_kind(POINTS[:0])[kind], name=name)


@pytest.mark.parametrize("format", [None, *FORMATS])
def test_no_bytes_are_an_empty_cloud(format: str | None):
    with pytest.raises(EmptyCloud, match="empty"):
        read(b"", format)


@kinds
@pytest.mark.parametrize("share", [0.02, 0.3, 0.6, 0.95])
def test_a_truncated_file_is_refused_with_a_word_on_it(kind: str, share: float):
    data = KINDS[kind]
    cut = data[: int(len(data) * share)]
    if kind.startswith("xyz"):  # text without a header may end anywhere: only a broken last line shows
        cut = cut[: cut.rindex(b"\n")] + b"\n0.1"
    with pytest.raises(UnreadableCloud, match=r"truncated|columns|column index|number of columns"):
        read(cut, kind.split()[0])


@kinds
def test_more_points_than_the_limit_are_refused(kind: str):
    with pytest.raises(TooManyPoints, match="200 points, is over the limit of 199"):
        read(KINDS[kind], max_points=199)
    assert len(read(KINDS[kind], max_points=200).points) == 200


HOSTILE = {
    f"{kind} promising {count}": data
    for side in (10**6, 2200)
    for count in (side * side,)
    for kind, data in {
        "pcd ascii": pcd_header(count, "ascii") + b"1 2 3\n" * 9,
        "pcd binary": pcd_header(count, "binary") + b"\0" * 99,
        "pcd compressed": pcd_header(count, "binary_compressed")
        + np.array([90, count * 12 % 2**32], "<u4").tobytes()
        + b"\xff" * 99,
        "ply ascii": ply_header(count, "ascii") + b"1 2 3\n" * 9,
        "ply binary": ply_header(count, "binary_little_endian") + b"\0" * 99,
        "ply lists": ply_header(count, "binary_big_endian", more="property list int int a\n") + b"\0" * 99,
        "ply faces": ply_header(1, "binary_little_endian", more=f"element face {count}\nproperty list uchar int i\n")
        + b"\0" * 99,
        "xyz": f"{count}\n1 2 3\n".encode(),
        "npy": npy_header((count, 3)) + b"\0" * 99,
        "pointcloud2": pointcloud2(POINTS[:2], height=side, width=side, row_step=side * 28),
        "npy fields": npy_header((count,), [("x", "<f8"), ("y", "<f8"), ("z", "<f8")]) + b"\0" * 99,
    }.items()
}


@pytest.mark.parametrize("hostile", HOSTILE)
def test_memory_follows_the_bytes_and_not_what_the_header_promises(hostile: str):
    read(KINDS["pcd compressed"])  # compiled beforehand
    tracemalloc.start()
    begin = time.perf_counter()
    with pytest.raises((TooManyPoints, UnreadableCloud), match=r"promise|over the limit|lists do not fit"):
        read(HOSTILE[hostile])
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 4 << 20
    assert time.perf_counter() - begin < 5


def test_a_zip_bomb_is_refused_before_it_unfolds():
    bomb = npz(True, points=np.zeros((20_000_000, 3), np.int8), other=np.zeros(50_000_000, np.int8))
    assert len(bomb) < 1 << 20
    tracemalloc.start()
    with pytest.raises(TooManyPoints, match="20000000 points"):
        read(bomb)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 4 << 20


@pytest.mark.parametrize(("unit", "metres"), [("m", 1), ("dm", 0.1), ("cm", 0.01), ("mm", 0.001), ("in", 0.0254)])
def test_a_stated_unit_becomes_metres(unit: str, metres: float):
    cloud = read(KINDS["ply little"], unit=unit)
    assert np.allclose(cloud.points, POINTS.astype(float) * metres, rtol=1e-7)


@pytest.mark.parametrize("unit", ["", "mile", "M", "nm" * 500])
def test_an_unknown_unit_is_refused_with_those_that_exist(unit: str):
    with pytest.raises(InvalidParameter, match="mm"):
        read(KINDS["npy"], unit=unit)


def test_a_limit_below_one_is_refused():
    with pytest.raises(InvalidParameter, match="max_points"):
        read(KINDS["npy"], max_points=0)


def test_a_viewpoint_stated_by_the_caller_overrides_the_file():
    data = pcd(POINTS, VIEWPOINT="1 2 3 0.5 0.5 0.5 0.5")
    assert not np.allclose(read(data).points, POINTS)
    assert np.array_equal(read(data, viewpoint=Viewpoint()).points, POINTS)


@kinds
def test_a_viewpoint_means_the_same_in_every_format(kind: str):
    pose = Viewpoint((0.3, -0.2, 0.1), (0.9, 0.1, -0.3, 0.2))
    expected = (POINTS.astype(float) - pose.position) @ pose.rotation
    assert np.allclose(read(KINDS[kind], viewpoint=pose).points, expected, atol=1e-7)


@pytest.mark.filterwarnings("error")
def test_coordinates_beyond_float32_are_an_error_and_no_warning():
    with pytest.raises(ImplausibleExtent, match="unit"):
        read(b"1e39 0 1\n0 0 1\n", "xyz")


def test_a_format_that_does_not_exist_is_refused_with_those_that_do():
    with pytest.raises(UnsupportedFormat, match="pcd, ply, xyz, npy, npz"):
        read(KINDS["npy"], "stl")


def test_content_that_contradicts_the_stated_format_is_refused():
    with pytest.raises(UnreadableCloud, match="its content is ply"):
        read(KINDS["ply ascii"], "pcd")


def test_content_decides_over_a_misleading_name():
    assert np.array_equal(read(KINDS["ply big"], name="cloud.pcd").points, POINTS)


def test_what_is_written_opens_as_what_it_was():
    cloud = read(write_ply(PointCloud(POINTS)))
    assert np.array_equal(cloud.points, POINTS)


def test_a_million_points_of_text_read_in_seconds():
    data = rows_of(some_points(1000)) * 1000
    begin = time.perf_counter()
    assert len(read(data).points) == 1_000_000
    assert time.perf_counter() - begin < 10


def read_or_refuse(data: bytes, format: str | None) -> None:
    """Holds for any bytes at all: a cloud of finite points, or an error of ours, and no warning."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", "Reading `.npy` or `.npz` file required additional header parsing")
        try:
            cloud = read(data, format, max_points=10_000)
        except ShapeConceptsError as error:
            said = str(error)
            assert 20 < len(said) < 1000
            return
    assert cloud.points.shape[1:] == (3,)
    assert len(cloud.points)
    assert np.isfinite(cloud.points).all()


@settings(max_examples=300, deadline=None, derandomize=True)
@given(data=st.binary(max_size=300), format=st.sampled_from([None, *FORMATS]))
def test_random_bytes_never_crash(data: bytes, format: str | None):
    read_or_refuse(data, format)


@settings(max_examples=300, deadline=None, derandomize=True)
@given(text=st.text("0123456789.,;#/-+einfax \t\r\n\x00é", max_size=200))
def test_random_text_never_crashes(text: str):
    read_or_refuse(text.encode(), "xyz")


@settings(max_examples=1500, deadline=None, derandomize=True)
@given(
    kind=st.sampled_from(sorted(SMALL)),
    edits=st.lists(st.tuples(st.integers(0, 500), st.integers(0, 2), st.binary(max_size=4)), max_size=6),
    cut=st.integers(0, 3000),
)
def test_damaged_files_never_crash(kind: str, edits: list[tuple[int, int, bytes]], cut: int):
    data = SMALL[kind]
    for place, gone, new in edits:
        data = data[:place] + new + data[place + gone :]
    read_or_refuse(data[:cut], None)
    read_or_refuse(data, kind.split()[0])


HEADER_WORDS = ["0", "1", "-1", "3", "12", "99999999999", "1e3", "nan", "x", "y", "z", "list", "uchar", "int", "double",
                "float", "vertex", "face", "F", "U", "4", "8", "binary", "ascii", "\n", "property", "element", "COUNT",
                "WIDTH", "VIEWPOINT", "format", "DATA", ""]  # fmt: skip


@settings(max_examples=1500, deadline=None, derandomize=True)
@given(
    kind=st.sampled_from([kind for kind in sorted(SMALL) if kind[:3] in ("pcd", "ply")]),
    edits=st.lists(st.tuples(st.integers(0, 60), st.sampled_from(HEADER_WORDS)), min_size=1, max_size=5),
)
def test_contradictory_headers_never_crash(kind: str, edits: list[tuple[int, str]]):
    head, mark, body = SMALL[kind].partition(b"DATA" if kind.startswith("pcd") else b"end_header")
    words = head.decode().replace("\n", " \n ").split(" ")
    for place, word in edits:
        words[place % len(words)] = word
    read_or_refuse(" ".join(words).encode() + mark + body, kind.split()[0])


@pytest.mark.data
def test_real_scans_are_read_whole(scans):
    files = sorted(scans.glob("*/objects/*.ply"))
    assert files
    for file in files[::10]:
        points = read(file.read_bytes(), name=file.name).points
        assert len(points) > 100
        assert points[:, 2].min() > 0.1


@pytest.mark.data
def test_real_scenes_lose_their_missing_points_and_nothing_else(scans):
    files = sorted(scans.glob("scenes/*.pcd"))
    assert files
    for file in files:
        points = read(file.read_bytes(), name=file.name).points
        assert 100_000 < len(points) < 640 * 480
        assert 0.4 < points[:, 2].min() < points[:, 2].max() < 2


def test_clouds_need_nothing_but_the_engine():
    loaded = subprocess.run(
        [sys.executable, "-c", "import sys, service.clouds; print(*sys.modules)"], capture_output=True, check=True
    )
    assert not {b"open3d", b"fastapi", b"worker", b"obstore"} & set(loaded.stdout.split())
