"""NumPy archives: which array is the cloud, and what a hostile zip may not do."""

from __future__ import annotations

import io
import tracemalloc
import zipfile

import numpy as np
import pytest

from service.clouds import read
from service.engine.errors import UnreadableCloud
from tests.service.clouds.written import npy, npy_header, npz, some_points

POINTS = some_points()
IMAGE = np.zeros((10, 20, 3), np.uint8)


@pytest.mark.parametrize(
    "arrays",
    [
        {"points": POINTS, "normals": -POINTS},
        {"xyz": POINTS, "normals": -POINTS},
        {"cloud": POINTS, "positions": -POINTS},
        {"positions": POINTS, "arr_0": -POINTS},
        {"points": POINTS, "xyz": -POINTS},
        {"anything": POINTS},
        {"anything": POINTS, "label": np.array("mug"), "k": np.eye(2)},
        {"depth": POINTS, "image": IMAGE},
    ],
    ids=lambda arrays: "+".join(arrays),
)
@pytest.mark.parametrize("compressed", [False, True])
def test_the_cloud_is_found_among_the_arrays(arrays: dict, compressed: bool):
    assert np.array_equal(read(npz(compressed, **arrays)).points, POINTS)


@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        ({"a": POINTS, "b": POINTS}, "2 can be a cloud"),
        ({"a": np.zeros(3)}, "0 can be a cloud"),
        ({}, "0 can be a cloud"),
        ({"points": np.zeros((5, 2))}, "shape"),
        ({"points": np.array([[None] * 3], dtype=object)}, "never loaded"),
    ],
)
def test_an_archive_without_one_cloud_is_refused(arrays: dict, said: str):
    with pytest.raises(UnreadableCloud, match=said):
        read(npz(**arrays))


def zipped(method: int = zipfile.ZIP_DEFLATED, **members: bytes) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return stream.getvalue()


def test_a_zip_of_other_things_is_refused():
    with pytest.raises(UnreadableCloud, match="no readable array header"):
        read(zipped(**{"readme.txt": b"hello"}))


def test_a_member_that_ends_early_is_refused():
    with pytest.raises(UnreadableCloud, match="truncated"):
        read(zipped(**{"points.npy": npy(POINTS)[:-5]}))


def test_a_flipped_bit_in_the_data_is_noticed():
    data = bytearray(npz(points=POINTS))
    data[1000] ^= 1
    with pytest.raises(UnreadableCloud, match="damaged"):
        read(bytes(data))


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_compressions_that_numpy_does_not_write_are_refused(method: int):
    with pytest.raises(UnreadableCloud, match="another method"):
        read(zipped(method, **{"points.npy": npy(POINTS)}))


def test_thousands_of_members_are_refused():
    with pytest.raises(UnreadableCloud, match="more than 1000"):
        read(zipped(zipfile.ZIP_STORED, **{f"m{i}.npy": b"" for i in range(1001)}))


@pytest.mark.parametrize(
    "member",
    [
        npy_header((100, 3), "<f4") + b"\0" * 200_000_000,  # far more than its shape
        b"\x93NUMPY\x02\x00\xff\xff\xff\xff" + b" " * 200_000_000,  # a header without end
    ],
    ids=["values without end", "header without end"],
)
def test_a_member_that_unfolds_without_end_is_read_no_further_than_needed(member: bytes):
    bomb = zipped(**{"points.npy": member})
    tracemalloc.start()
    with pytest.raises(Exception, match=r"none of the 100 points|no readable array header"):
        read(bomb)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 4 << 20
