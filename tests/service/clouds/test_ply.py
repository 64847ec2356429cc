"""PLY of both endians and ascii, with the elements and lists that meshes carry."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from service.clouds import read, write_ply
from service.engine.cloud import PointCloud
from service.engine.errors import UnreadableCloud
from tests.service.clouds.written import ply as written
from tests.service.clouds.written import ply_header, rows_of, some_points

POINTS = some_points()
ENCODINGS = ("ascii", "binary_little_endian", "binary_big_endian")


@pytest.mark.parametrize("ascii", [True, False])
def test_what_open3d_writes_is_read(ascii: bool, tmp_path: Path):
    o3d = pytest.importorskip("open3d", reason="Open3D comes with the extra `worker`")
    mesh = o3d.geometry.TriangleMesh.create_sphere(0.1).translate((0, 0, 1))
    mesh.compute_vertex_normals()
    o3d.io.write_triangle_mesh(str(tmp_path / "mesh.ply"), mesh, write_ascii=ascii)
    points = read((tmp_path / "mesh.ply").read_bytes()).points
    assert np.allclose(points, np.asarray(mesh.vertices), atol=1e-6)


def test_what_is_written_open3d_reads(tmp_path: Path):
    o3d = pytest.importorskip("open3d", reason="Open3D comes with the extra `worker`")
    (tmp_path / "cloud.ply").write_bytes(write_ply(PointCloud(POINTS)))
    cloud = o3d.io.read_point_cloud(str(tmp_path / "cloud.ply"))
    assert np.array_equal(np.asarray(cloud.points, np.float32), POINTS)


def test_what_is_written_says_its_unit_and_frame():
    header = write_ply(PointCloud(POINTS)).partition(b"end_header")[0].decode()
    assert "comment metres; camera at the origin" in header


def mesh(encoding: str) -> bytes:
    """A material before the vertices, whose coordinates stand among lists, and faces after them."""
    header = (
        f"ply\nformat {encoding} 1.0\nobj_info made for a test\ncomment \xc3\x85\n"
        "element material 2\nproperty uchar kind\nproperty list int double shades\n"
        f"element vertex {len(POINTS)}\n"
        "property uchar red\nproperty double x\nproperty list uchar short marks\nproperty float z\nproperty float64 y\n"
        "element face 3\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode("latin-1")
    order = ">" if "big" in encoding else "<"
    numbers: list[list[tuple[str, float]]] = [
        [("u1", 1), ("i4", 3), ("f8", 0.1), ("f8", 0.2), ("f8", 0.3)],
        [("u1", 2), ("i4", 0)],
    ]
    for i, (x, y, z) in enumerate(POINTS):
        marks = [("i2", k) for k in range(i % 3)]
        numbers.append([("u1", 255), ("f8", x), ("u1", len(marks)), *marks, ("f4", z), ("f8", y)])
    numbers += [[("u1", 3), ("i4", 0), ("i4", 1), ("i4", 2)]] * 3
    if encoding == "ascii":
        return header + b"".join(" ".join(repr(float(v)) if k[0] == "f" else str(v) for k, v in row).encode() + b"\n"
                                 for row in numbers)  # fmt: skip
    return header + b"".join(np.array(value, order + kind).tobytes() for row in numbers for kind, value in row)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_lists_and_other_elements_are_passed_over(encoding: str):
    assert np.array_equal(read(mesh(encoding)).points, POINTS)


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("gone", [3, 40, 2000])
def test_a_mesh_that_ends_early_is_refused_even_in_its_faces(encoding: str, gone: int):
    with pytest.raises(UnreadableCloud, match="truncated"):
        read(mesh(encoding)[: -gone - 10])


@pytest.mark.parametrize("encoding", ENCODINGS[1:])
def test_a_list_longer_than_the_file_is_refused(encoding: str):
    header = ply_header(1, encoding, more="element face 1\nproperty list uint64 double i\n")
    with pytest.raises(UnreadableCloud, match="lists do not fit"):
        read(header + b"\0" * 12 + b"\xff" * 8)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_whole_numbers_are_coordinates_too(encoding: str):
    whole = np.round(POINTS * 1000).astype(np.int16)
    bodies = {
        "ascii": rows_of(whole).replace(b".0", b""),
        "binary_little_endian": whole.astype("<i2").tobytes(),
        "binary_big_endian": whole.astype(">i2").tobytes(),
    }
    data = ply_header(len(whole), encoding, "short") + bodies[encoding]
    assert np.allclose(read(data, unit="mm").points, whole / 1000, atol=1e-7)


@pytest.mark.parametrize("ending", [b"\r\n", b"\r"])
@pytest.mark.parametrize("encoding", ENCODINGS)
def test_other_line_endings_are_read(ending: bytes, encoding: str):
    header, mark, body = written(POINTS, encoding).partition(b"end_header\n")
    if encoding == "ascii":
        body = body.replace(b"\n", ending)
    assert np.array_equal(read((header + mark).replace(b"\n", ending) + body).points, POINTS)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("vertex", "wertex", "one vertex element, not 0"),
        ("property float y\n", "", "a number y"),
        ("property float y", "property list uchar float y", "a number y"),
        ("property float y", "property real y", "property 'real y'"),
        ("property float y", "property list float float y", "property 'list float float y'"),
        ("property float y", "property float", "property 'float'"),
        ("property float y", "proprety float y", "does not belong"),
        ("vertex 200", "vertex -1", "whole number"),
        ("vertex 200", "vertex", "does not belong"),
        ("format ascii 1.0\n", "", "does not belong"),
        ("format ascii", "format binary_middle_endian", "does not belong"),
        ("end_header", "end", "no header"),
        ("element vertex 200\n", "", "does not belong"),
    ],
)
def test_a_header_that_makes_no_sense_is_refused_with_the_reason(old: str, new: str, said: str):
    data = written(POINTS, "ascii")
    assert old.encode() in data
    with pytest.raises(UnreadableCloud, match=said):
        read(data.replace(old.encode(), new.encode(), 1))


def test_two_vertex_elements_are_refused():
    with pytest.raises(UnreadableCloud, match="not 2"):
        read(ply_header(1, "ascii", more="element vertex 1\nproperty float x\n") + b"1 2 3\n4\n")


def test_rows_of_other_lengths_are_refused():
    with pytest.raises(UnreadableCloud, match="4 columns, its header promises 3"):
        read(ply_header(2, "ascii") + b"1 2 3 4\n5 6 7 8\n")
