"""NumPy arrays of every type and layout that is a cloud, and those that are not."""

from __future__ import annotations

import io

import numpy as np
import pytest

from service.clouds import npy as npy_files
from service.clouds import read
from service.engine.errors import UnreadableCloud
from tests.service.clouds.written import npy, npy_header, some_points

POINTS = some_points()


@pytest.mark.parametrize("kind", ["<f4", ">f4", "<f8", ">f8", "<f2", "g"])
def test_floats_of_any_size_and_byte_order_are_read(kind: str):
    assert np.array_equal(read(npy(POINTS.astype(kind))).points, POINTS.astype(kind).astype(np.float32))


@pytest.mark.parametrize("kind", ["i2", ">i4", "i8", "u2", ">u8"])
def test_whole_numbers_are_read(kind: str):
    whole = np.abs(np.round(POINTS * 1000)).astype(kind)
    assert np.allclose(read(npy(whole), unit="mm").points, whole / 1000, atol=1e-7)


@pytest.mark.parametrize("order", ["C", "F"])
def test_further_columns_are_ignored(order: str):
    wide = np.asarray(np.hstack([POINTS, POINTS + 9]), order=order)
    assert np.array_equal(read(npy(wide)).points, POINTS)


@pytest.mark.parametrize("order", ["C", "F"])
def test_an_organised_array_gives_its_points_row_after_row(order: str):
    grid = np.asarray(POINTS.reshape(10, 20, 3), order=order)
    assert np.array_equal(read(npy(grid)).points, POINTS)


@pytest.mark.parametrize("shape", [(200,), (10, 20)])
def test_fields_x_y_z_are_read_from_among_others(shape: tuple[int, ...]):
    array = np.zeros(200, [("rgb", "u4"), ("z", ">f8"), ("x", "f4"), ("y", "f4"), ("ring", "u1", 3)])
    for i, axis in enumerate("xyz"):
        array[axis] = POINTS[:, i]
    assert np.array_equal(read(npy(array.reshape(shape))).points, POINTS)


@pytest.mark.parametrize("version", [(1, 0), (2, 0), (3, 0)])
def test_every_version_of_the_header_is_read(version: tuple[int, int], tmp_path):
    with (tmp_path / "cloud.npy").open("wb") as file:
        np.lib.format.write_array(file, POINTS, version=version)
    assert np.array_equal(read((tmp_path / "cloud.npy").read_bytes()).points, POINTS)


class Trap:
    """Unpickled, it would run."""

    def __reduce__(self):
        return (pytest.fail, ("it was unpickled",))


@pytest.mark.parametrize(
    ("array", "said"),
    [
        (np.array([[Trap()] * 3], dtype=object), "never loaded"),
        (np.zeros((5, 3), complex), "type 'complex128'"),
        (np.zeros((5, 3), bool), "type 'bool'"),
        (np.full((5, 3), "x"), "type '<U1'"),
        (np.zeros(3), "shape"),
        (np.zeros((5, 2)), "shape"),
        (np.zeros((2, 3, 4, 5)), "shape"),
        (np.array(1.0), "shape"),
        (np.zeros((480, 640), "f4"), "is it a depth image"),
        (np.zeros((3, 500)), "transposed"),
        (np.zeros(5, [("x", "f4"), ("y", "f4")]), "fields"),
        (np.zeros(5, [("x", "f4"), ("y", "f4"), ("z", "f4", 2)]), "fields"),
        (np.zeros(5, [("x", "f4"), ("y", "f4"), ("z", "U3")]), "fields"),
    ],
)
def test_an_array_that_is_no_cloud_is_refused_with_the_reason(array: np.ndarray, said: str):
    with pytest.raises(UnreadableCloud, match=said):
        read(npy(array))


@pytest.mark.parametrize(
    "data",
    [
        b"\x93NUMPY",
        b"\x93NUMPY\x09\x00",
        b"\x93NUMPY\x02\x00\xff\xff\xff\xff{",
        b"\x93NUMPY\x01\x00\x80\x00" + b"(" * 128,
        npy_header((5, 3)).replace(b"'shape'", b"'shale'"),
    ],
)
def test_a_damaged_header_is_refused(data: bytes):
    with pytest.raises(UnreadableCloud, match="no readable array header"):
        read(data)


def test_a_negative_shape_is_refused():
    with pytest.raises(UnreadableCloud, match="negative"):
        read(npy_header((-5, 3)))


@pytest.mark.parametrize("kind", ["<f4", ">f4", "<f8", "<f2", "|i1", "|u1", ">u2", "<i8", "<c8", "|b1", "<U3"])
@pytest.mark.parametrize("shape", [(5, 3), (0, 3), (4, 5, 3), (7,), (), (2, 2, 2, 3)])
def test_a_header_is_read_as_numpy_reads_it(kind: str, shape: tuple[int, ...]):
    for order in "CF":
        file = io.BytesIO()
        np.save(file, np.zeros(shape, kind, order=order))
        file.seek(0)
        np.lib.format.read_magic(file)
        found, fortran, dtype = np.lib.format.read_array_header_1_0(file)
        assert npy_files.read_layout(file.getvalue(), "this") == npy_files.Layout(dtype, found, fortran, file.tell())


@pytest.mark.parametrize("count", [0, 1, 9, 10, 99_999, 12_345_678])
def test_bare_points_get_a_header_that_numpy_reads(count: int):
    file = npy_files.of_points(bytes(12 * count))
    assert np.load(io.BytesIO(file)).shape == (count, 3)
    assert (len(file) - 12 * count) % 64 == 0
