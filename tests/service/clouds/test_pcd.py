"""PCD as PCL and Open3D write it, and headers that contradict themselves."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from service.clouds import Viewpoint, pcd, read
from service.engine.errors import EmptyCloud, TooManyPoints, UnreadableCloud
from tests.service.clouds.written import lzf_block, pcd_header, rows_of, some_points
from tests.service.clouds.written import pcd as written

POINTS = some_points()
ENCODINGS = ("ascii", "binary", "binary_compressed")


@pytest.mark.parametrize("options", [{"write_ascii": True}, {}, {"compressed": True}], ids=ENCODINGS)
def test_what_open3d_writes_is_read_bit_for_bit(options: dict[str, bool], tmp_path: Path):
    o3d = pytest.importorskip("open3d", reason="Open3D comes with the extra `worker`")
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(POINTS.astype(float)))
    cloud.colors = o3d.utility.Vector3dVector(np.random.default_rng(0).random(POINTS.shape))
    o3d.io.write_point_cloud(str(tmp_path / "cloud.pcd"), cloud, **options)
    assert np.array_equal(read((tmp_path / "cloud.pcd").read_bytes()).points, POINTS)


def test_a_real_compression_with_back_references_is_read(tmp_path: Path):
    o3d = pytest.importorskip("open3d", reason="Open3D comes with the extra `worker`")
    grid = np.stack(np.meshgrid(np.arange(64), np.arange(64), [1.0]), axis=-1).reshape(-1, 3) / 128
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(grid))
    o3d.io.write_point_cloud(str(tmp_path / "cloud.pcd"), cloud, compressed=True)
    data = (tmp_path / "cloud.pcd").read_bytes()
    assert len(data) < grid.size * 4
    assert np.array_equal(read(data).points, grid.astype(np.float32))


MIXED = np.dtype([("label", "<u2"), ("hist", "<f4", 3), ("z", "<f8"), ("x", "<f4"), ("rgb", "<u4"), ("y", "<f8")])
MIXED_HEADER = {
    "FIELDS": "label hist z x rgb y",
    "SIZE": "2 4 8 4 4 8",
    "TYPE": "U F F F U F",
    "COUNT": "1 3 1 1 1 1",
}


def mixed(encoding: str) -> bytes:
    rows = np.zeros(len(POINTS), MIXED)
    rows["label"], rows["hist"], rows["rgb"] = 7, 0.5, 0xFFAA00
    for i, axis in enumerate("xyz"):
        rows[axis] = POINTS[:, i]
    bodies = {
        "binary": rows.tobytes(),
        "binary_compressed": lzf_block(b"".join(rows[name].tobytes() for name in MIXED.names or ())),
        "ascii": b"".join(b"7 0.5 0.5 0.5 %r %r 16755200 %r\n" % (float(z), float(x), float(y)) for x, y, z in POINTS),
    }
    return pcd_header(len(POINTS), encoding, **MIXED_HEADER) + bodies[encoding]


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_fields_of_any_type_count_and_order_are_passed_over(encoding: str):
    assert np.array_equal(read(mixed(encoding)).points, POINTS)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_an_organised_cloud_gives_its_points_row_after_row(encoding: str):
    holed = POINTS.copy()
    holed[::3] = np.nan
    cloud = read(written(holed, encoding, WIDTH=20, HEIGHT=10))
    assert np.array_equal(cloud.points, holed[np.isfinite(holed[:, 0])])


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_the_viewpoint_of_the_file_is_honoured(encoding: str):
    pose = Viewpoint((0.1, -2.0, 0.5), (0.5, -0.5, 0.5, -0.5))
    in_the_world = POINTS.astype(float) @ pose.rotation.T + pose.position
    data = written(in_the_world.astype(np.float32), encoding, VIEWPOINT="0.1 -2.0 0.5 0.5 -0.5 0.5 -0.5")
    assert np.allclose(read(data).points, POINTS, atol=1e-6)


@pytest.mark.parametrize("version", [".5", ".6", "0.6", "0.7"])
def test_old_headers_without_count_viewpoint_and_points_are_read(version: str):
    data = written(POINTS, "ascii", VERSION=version, COUNT=None, VIEWPOINT=None, POINTS=None)
    assert np.array_equal(read(data).points, POINTS)


def test_line_endings_of_windows_are_read():
    assert np.array_equal(read(written(POINTS, "ascii").replace(b"\n", b"\r\n")).points, POINTS)


def test_comments_and_blank_lines_in_the_header_are_passed_over():
    data = b"# made by hand: \xc3\x85\n\n" + written(POINTS, "binary")
    assert np.array_equal(read(data).points, POINTS)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"FIELDS": "x y"}, "names 2 fields, 3 sizes"),
        ({"FIELDS": None}, "names 0 fields"),
        ({"FIELDS": "a b c"}, "none of its fields"),
        ({"SIZE": "4 4 3"}, "SIZE 3"),
        ({"SIZE": "2 4 4"}, "field x should be one F of 4 or 8 bytes"),
        ({"SIZE": "4 4 -4"}, "whole number"),
        ({"TYPE": "F F Q"}, "TYPE 'Q'"),
        ({"COUNT": "1 1 0"}, "COUNT 0"),
        ({"COUNT": "2 1 1"}, "field x should be one"),
        ({"WIDTH": "many"}, "WIDTH should be a whole number"),
        ({"WIDTH": "1 2"}, "WIDTH should be one number"),
        ({"WIDTH": "-200", "POINTS": None}, "WIDTH should be a whole number"),
        ({"HEIGHT": 7}, "POINTS 200 is not WIDTH times HEIGHT, 1400"),
        ({"WIDTH": None, "HEIGHT": None, "POINTS": None}, "neither WIDTH and HEIGHT nor POINTS"),
        ({"VIEWPOINT": "0 0 0"}, "VIEWPOINT"),
        ({"VIEWPOINT": "0 0 0 0 0 0 0"}, "quaternion that is not zero"),
        ({"VIEWPOINT": "nan 0 0 1 0 0 0"}, "VIEWPOINT"),
        ({"DATA": "zipped"}, "ascii, binary, binary_compressed"),
        ({"DATA": None}, "no DATA line"),
    ],
)
def test_a_header_that_makes_no_sense_is_refused_with_the_reason(changed: dict[str, str], said: str):
    with pytest.raises(UnreadableCloud, match=said):
        read(written(POINTS, "ascii", **changed))


def test_a_header_without_points_is_an_empty_cloud():
    with pytest.raises(EmptyCloud):
        read(pcd_header(0, "binary"))


def test_rows_of_other_lengths_are_refused_rather_than_shifted():
    data = written(POINTS, "ascii")
    cut = data[: data.rindex(b" ")] + b"\n"
    with pytest.raises(UnreadableCloud, match="number of columns changed"):
        read(cut)
    with pytest.raises(UnreadableCloud, match="rows have 3 columns, its header promises 4"):
        read(
            pcd_header(3, "ascii", FIELDS="x y z i", SIZE="4 4 4 4", TYPE="F F F F", COUNT="1 1 1 1")
            + rows_of(some_points(3))
        )


@pytest.mark.parametrize(
    ("block", "said"),
    [
        (b"", "promises 8 bytes"),
        (struct.pack("<II", 10, 2399) + b"\0" * 10, "unfolds to 2399 bytes"),
        (struct.pack("<II", 500, 2400) + b"\0" * 10, "promises 500 bytes"),
        (struct.pack("<II", 10, 2400) + b"\0" * 10, "cannot unfold"),
        (struct.pack("<II", 100, 2400) + b"\x20\x00" * 50, "damaged after 0 of 2400"),  # refers to before its start
        (struct.pack("<II", 100, 2400) + b"\x00" * 100, "damaged after 50 of 2400"),  # ends early
        (struct.pack("<II", 100, 2400) + b"\x00\x00" * 49 + b"\x00\xff", "damaged after 50 of 2400"),
    ],
)
def test_a_damaged_compressed_block_is_refused(block: bytes, said: str):
    with pytest.raises(UnreadableCloud, match=said):
        read(pcd_header(200, "binary_compressed") + block)


def test_a_compressed_block_beyond_all_proportion_is_refused():
    wide = {"FIELDS": "x y z f", "SIZE": "4 4 4 8", "TYPE": "F F F F", "COUNT": "1 1 1 1000"}
    block = struct.pack("<II", 0, 8012 * 20_000) + b"\0"
    with pytest.raises(TooManyPoints, match="would unfold to 160240000 bytes"):
        pcd.read(pcd_header(20_000, "binary_compressed", **wide) + block, max_points=20_000)


def test_bytes_after_the_last_point_are_passed_over():
    assert np.array_equal(read(written(POINTS) + b"\n\n").points, POINTS)
