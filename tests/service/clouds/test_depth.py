"""Depth images: where their pixels lie in space, what is missing, masks, and what hostile pictures may not do."""

from __future__ import annotations

import struct
import time
import tracemalloc
import warnings
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from service.clouds import DepthCamera, Viewpoint, parse_camera, read
from service.engine.errors import (
    EmptyCloud,
    InvalidParameter,
    NoFinitePoints,
    ShapeConceptsError,
    TooManyPoints,
    UnreadableCloud,
)
from tests.service.clouds.written import chunk, npy, npy_header, ply, png, some_points

CAMERA = DepthCamera(525.0, 520.0, 30.5, 23.5)
MM = np.random.default_rng(3).integers(500, 1500, (48, 62)).astype(np.uint16)
METRES = MM / 1000
EVERY = {
    "PNG": png(MM),
    "interlaced PNG": png(MM, interlaced=True),
    "uint16 NPY": npy(MM),
    "big-endian NPY": npy(MM.astype(">u2")),
    "int32 NPY": npy(MM.astype(np.int32)),
    "float64 NPY": npy(METRES),
    "float32 NPY": npy(METRES.astype(np.float32)),
    "Fortran's NPY": npy(np.asfortranarray(METRES)),
}
every = pytest.mark.parametrize("kind", EVERY)


@every
def test_every_pixel_projects_back_to_where_it_was(kind: str):
    points = read(EVERY[kind], camera=CAMERA).points.astype(float)
    assert len(points) == MM.size
    x, y, z = points.T
    rows, columns = np.indices(MM.shape)
    assert np.allclose(z, METRES.ravel(), rtol=1e-6)
    assert np.allclose(x / z * CAMERA.fx + CAMERA.cx, columns.ravel(), atol=1e-4)
    assert np.allclose(y / z * CAMERA.fy + CAMERA.cy, rows.ravel(), atol=1e-4)


@every
def test_a_stated_scale_goes_before_the_customary_one(kind: str):
    plain, scaled = EVERY[kind], DepthCamera(*(525.0, 520.0, 30.5, 23.5), scale=0.0002)
    unit = 1.0 if "float" in kind or "Fortran" in kind else 0.001
    assert np.allclose(read(plain, camera=scaled).points, read(plain, camera=CAMERA).points * 0.0002 / unit)


@pytest.mark.parametrize("missing", [0.0, np.nan, np.inf, -0.5])
def test_pixels_that_were_not_measured_keep_their_places(missing: float):
    holed = METRES.copy()
    holed[::5, 3] = missing
    cloud = read(npy(holed), camera=CAMERA)
    assert cloud.measured is not None
    assert np.array_equal(cloud.measured.reshape(MM.shape), holed == METRES)
    assert np.array_equal(cloud.points, read(npy(METRES), camera=CAMERA).points[cloud.measured])


def test_no_pixel_on_the_optical_axis_is_taken_for_missing():
    """Its point is (0, 0, z), and no sensor's own place."""
    cloud = read(EVERY["PNG"], camera=DepthCamera(525, 525, 30, 23))
    assert cloud.measured is None


OBJECT = np.zeros(MM.shape, bool)
OBJECT[10:30, 20:50] = True
MASKS = {
    "bool NPY": npy(OBJECT),
    "label NPY": npy(OBJECT * np.int64(7)),
    "8-bit PNG": png(OBJECT * np.uint8(255)),
    "label PNG": png(OBJECT * np.uint8(1)),
    "16-bit PNG": png(OBJECT * np.uint16(300)),
    "palette PNG": png(OBJECT * np.uint8(2), colour=3, palette=True),
}


@pytest.mark.parametrize("mask", MASKS)
def test_only_the_object_of_a_mask_is_kept_and_pixels_keep_their_numbers(mask: str):
    cloud = read(EVERY["PNG"], camera=CAMERA, mask=MASKS[mask])
    assert cloud.measured is not None
    assert np.array_equal(cloud.measured.reshape(MM.shape), OBJECT)
    assert np.array_equal(cloud.points, read(EVERY["PNG"], camera=CAMERA).points[OBJECT.ravel()])


def test_a_mask_of_single_bits_is_read(tmp_path: Path):
    Image.fromarray(OBJECT).save(tmp_path / "mask.png")
    cloud = read(EVERY["PNG"], camera=CAMERA, mask=(tmp_path / "mask.png").read_bytes())
    assert cloud.measured is not None
    assert np.array_equal(cloud.measured.reshape(MM.shape), OBJECT)


def test_what_another_program_writes_is_read_the_same(tmp_path: Path):
    Image.fromarray(MM).save(tmp_path / "depth.png", optimize=True)
    sent = (tmp_path / "depth.png").read_bytes()
    assert np.array_equal(read(sent, camera=CAMERA).points, read(EVERY["PNG"], camera=CAMERA).points)


@pytest.mark.parametrize(
    ("mask", "said"),
    [
        (png(OBJECT[:, :-1] * np.uint8(1)), "61 x 48 pixels, the depth image 62 x 48"),
        (npy(OBJECT.T), "48 x 62 pixels"),
        (npy(OBJECT.astype(float)), "bool or whole numbers"),
        (npy(OBJECT.ravel()), r"\(H, W\)"),
        (png(np.dstack([OBJECT] * 3) * np.uint8(255), colour=2), "in colour"),
        (MASKS["8-bit PNG"][:-40], "truncated"),
        (b"P5 62 48 255\n", "a PNG or an NPY"),
        (b"", "a PNG or an NPY"),
    ],
)
def test_a_mask_that_does_not_fit_is_refused_with_the_reason(mask: bytes, said: str):
    with pytest.raises(UnreadableCloud, match=said):
        read(EVERY["PNG"], camera=CAMERA, mask=mask)


def test_nothing_measured_and_nothing_masked_are_told_apart():
    with pytest.raises(NoFinitePoints, match="none of the 2976 pixels"):
        read(png(MM * np.uint16(0)), camera=CAMERA)
    with pytest.raises(NoFinitePoints, match="its mask"):
        read(EVERY["PNG"], camera=CAMERA, mask=npy(OBJECT & False))


@pytest.mark.parametrize(
    ("image", "said"),
    [
        (png(OBJECT * np.uint8(9)), "uint8, too coarse"),
        (png(OBJECT * np.uint8(9), colour=3, palette=True), "too coarse"),
        (png(np.dstack([MM] * 3), colour=2), "in colour"),
        (png(np.dstack([MM] * 2), colour=4), "transparency"),
        (npy(OBJECT), "bool, too coarse"),
        (npy(METRES.ravel()), r"\(H, W\)"),
        (npy(np.dstack([METRES] * 3)), r"\(H, W\)"),
        (npy(METRES.astype(complex)), "complex"),
        (npy(np.zeros((3, 3), [("x", "f4")])), "should be of numbers"),
        (npy(METRES)[:-1], "truncated"),
        (npy_header((-3, 3)), r"\(H, W\)"),
    ],
)
def test_an_image_that_holds_no_depth_is_refused_with_the_reason(image: bytes, said: str):
    with pytest.raises(UnreadableCloud, match=said):
        read(image, camera=CAMERA)


@pytest.mark.parametrize(
    ("data", "said", "given"),
    [
        (EVERY["PNG"], "needs the intrinsics", {}),
        (EVERY["PNG"], "needs the intrinsics", {"mask": MASKS["bool NPY"]}),
        (npy(some_points()), "needs the intrinsics", {"mask": MASKS["bool NPY"]}),
        (ply(some_points()), "this cloud is ply", {"camera": CAMERA}),
        (ply(some_points()), "this cloud is ply", {"mask": MASKS["bool NPY"]}),
        (EVERY["PNG"], "depth scale", {"camera": CAMERA, "unit": "mm"}),
        (EVERY["PNG"], "its own camera", {"camera": CAMERA, "viewpoint": Viewpoint((0, 0, 1))}),
    ],
)
def test_what_does_not_go_together_is_refused(data: bytes, said: str, given: dict[str, Any]):
    with pytest.raises(InvalidParameter, match=said):
        read(data, **given)


def test_a_camera_is_read_as_people_write_it():
    assert parse_camera("525,520,30.5,23.5") == CAMERA
    assert parse_camera(" 525, 520 ,30.5,23.5", 0.01) == DepthCamera(525, 520, 30.5, 23.5, 0.01)
    assert parse_camera(None) is parse_camera("") is None


@pytest.mark.parametrize(
    ("intrinsics", "scale"),
    [("1,2,3", None), ("1,2,3,4,5", None), ("a,b,c,d", None), ("0.8,1.1,0.5,0.5", None), ("nan,525,0,0", None),
     ("525,-525,0,0", None), ("525,525,inf,0", None), ("525,525,0,0", 0.0), ("525,525,0,0", float("nan")),
     ("525,525,0,0", -1.0), ("525,525,0,0", 1e9), (None, 0.001)],
)  # fmt: skip
def test_no_camera_is_refused_with_what_one_is(intrinsics: str | None, scale: float | None):
    with pytest.raises(InvalidParameter, match=r"fx|focal|principal|scale"):
        parse_camera(intrinsics, scale)


def header(columns: int, rows: int, bits: int = 16) -> bytes:
    return chunk(b"IHDR", struct.pack(">IIBBBBB", columns, rows, bits, 0, 0, 0, 0))


START, PIXELS, END = png(MM)[:8], chunk(b"IDAT", zlib.compress(bytes(2000))), chunk(b"IEND", b"")
BOMBS: dict[str, tuple[bytes, type[ShapeConceptsError], str]] = {
    "10^10 pixels": (START + header(10**5, 10**5) + PIXELS + END, TooManyPoints, "10000000000 points"),
    "2^63 pixels": (START + header(2**32 - 1, 2**31) + PIXELS + END, TooManyPoints, "over the limit"),
    "no pixels": (START + header(0, 5) + PIXELS + END, EmptyCloud, "no points"),
    "a second, larger header": (START + header(62, 48) + header(2000, 2000) + PIXELS + END, UnreadableCloud, "two"),
    "pixels without end": (
        START + header(62, 48) + chunk(b"IDAT", zlib.compress(bytes(1 << 28), 9)) + END, NoFinitePoints, "0, negative"),
    "text without end": (
        START + header(62, 48) + chunk(b"zTXt", b"a\0\0" + zlib.compress(bytes(1 << 28), 9)) + PIXELS + END,
        UnreadableCloud, "Decompressed data too large"),
    "pixels that end early": (
        START + header(62, 48) + chunk(b"IDAT", zlib.compress(MM.tobytes())[:99]) + END, UnreadableCloud, "truncated"),
    "no end": (EVERY["PNG"][:-12], UnreadableCloud, "truncated"),
    "an NPY of 10^12 pixels": (npy_header((10**6, 10**6)) + b"\0" * 99, TooManyPoints, "over the limit"),
    "an NPY of fewer bytes": (npy_header((2000, 2000)) + b"\0" * 99, UnreadableCloud, "promises"),
}  # fmt: skip


@pytest.mark.parametrize("bomb", BOMBS)
def test_memory_follows_the_limit_and_not_what_a_picture_claims(bomb: str):
    data, kind, said = BOMBS[bomb]
    tracemalloc.start()
    begin = time.perf_counter()
    with pytest.raises(kind, match=said):
        read(data, camera=CAMERA)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 4 << 20
    assert time.perf_counter() - begin < 2
    with pytest.raises(kind, match=said if kind is not NoFinitePoints else "its mask"):
        read(EVERY["PNG"], camera=CAMERA, mask=data)


def test_a_flipped_bit_is_noticed():
    data = bytearray(EVERY["PNG"])
    data[len(data) // 2] ^= 1
    with pytest.raises(UnreadableCloud, match="damaged"):
        read(bytes(data), camera=CAMERA)


SMALL = {"PNG": png(MM[:5, :7]), "NPY": npy(MM[:5, :7]), "interlaced": png(MM[:5, :7], interlaced=True)}


@settings(max_examples=1000, deadline=None, derandomize=True)
@given(
    kind=st.sampled_from(sorted(SMALL)),
    edits=st.lists(st.tuples(st.integers(8, 200), st.integers(0, 2), st.binary(max_size=4)), max_size=4),
    cut=st.integers(0, 400),
    mask=st.booleans(),
    sealed=st.booleans(),
)
def test_damaged_images_never_crash(kind: str, edits: list[tuple[int, int, bytes]], cut: int, mask: bool, sealed: bool):
    data = SMALL[kind]
    for place, gone, new in edits:
        data = data[:place] + new + data[place + gone :]
    data = data[:cut] if cut < 200 else data
    if sealed and len(data) > 33:  # a header with the right checksum gets farther
        data = data[:29] + struct.pack(">I", zlib.crc32(data[12:29])) + data[33:]
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Reading `.npy` or `.npz` file required additional header parsing")
        try:
            sent = (SMALL["PNG"], data) if mask else (data, None)
            cloud = read(sent[0], camera=CAMERA, mask=sent[1], max_points=10_000)
        except ShapeConceptsError as error:
            said = str(error)
            assert 20 < len(said) < 1000
        else:
            assert np.isfinite(cloud.points).all()


@pytest.mark.data
def test_a_real_scene_as_a_depth_image_and_its_mask_is_the_cloud_that_it_was(scans: Path):
    """The scenes come from a camera of f = 525 pixels: their depths alone give all coordinates back."""
    camera = DepthCamera(525, 525, 319.5, 239.5)
    for file in sorted(scans.glob("scenes/*.pcd")):
        whole = read(file.read_bytes())
        assert whole.measured is not None
        xyz = np.full((480 * 640, 3), np.nan, np.float32)
        xyz[whole.measured] = whole.points
        depth = xyz[:, 2].reshape(480, 640)
        again = read(npy(depth), camera=camera)
        assert np.allclose(again.points, whole.points, atol=2e-3)
        millimetres = np.nan_to_num(np.round(depth * 1000)).astype(np.uint16)
        near = depth < 0.9
        cloud = read(png(millimetres), camera=camera, mask=png(near * np.uint8(255)))
        assert cloud.measured is not None
        assert np.array_equal(cloud.measured, near.ravel())
        assert np.allclose(cloud.points, xyz[near.ravel()], atol=2e-3)
