"""NPY, NumPy's array file.

NumPy reads the header; the data is mapped here, since NumPy allocates what a header claims.
"""

from __future__ import annotations

import io
import math
import re
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from service.clouds.claims import check_bytes, check_count, quote
from service.clouds.frame import RawCloud
from service.engine.errors import UnreadableCloud

SIGNATURE = b"\x93NUMPY"
START = 10  # bytes before the header: the signature, the version 1.0, the header's length
ALIGNED = 64  # bytes: where data begins, NumPy has it at a multiple of them
_LENGTH = rb"(?:0|[1-9]\d{0,14})"
_USUAL = re.compile(
    rb"\x93NUMPY\x01\x00(?P<length>..)\{'descr': '(?P<type>[<>|](?:f[248]|[iu][1248]))', "
    rb"'fortran_order': (?P<fortran>True|False), 'shape': \((?P<shape>%b(?:, %b){1,2})\), \} *\n" % (_LENGTH, _LENGTH),
    re.DOTALL,
)
HEADER_LIMIT = 1 << 14  # bytes; NumPy itself refuses headers beyond 10,000
MOST_COLUMNS = 64  # more is a depth image, or an array that lies on its side


class Layout(NamedTuple):
    """What an array's header says; its data begins at byte `body`."""

    dtype: np.dtype
    shape: tuple[int, ...]
    fortran: bool
    body: int

    @property
    def points(self) -> int:
        """How many points the array has, if it is a cloud."""
        return math.prod(self.shape if self.dtype.names else self.shape[:-1])

    @property
    def width(self) -> int | None:
        """Points in a row, where the array is an image."""
        shape = self.shape if self.dtype.names else self.shape[:-1]
        return shape[1] if len(shape) == 2 else None

    @property
    def size(self) -> int:
        """Bytes of its data."""
        return math.prod(self.shape) * self.dtype.itemsize


def read(data: bytes, max_points: int) -> RawCloud:
    """Reads an array (N, 3+) or (H, W, 3+), or one with the fields x, y, z.

    Raises:
        EmptyCloud, TooManyPoints: by the array's shape.
        UnreadableCloud: no such array, one of Python objects, or fewer bytes than its shape needs.
    """
    layout = read_layout(data[:HEADER_LIMIT], "this NPY")
    if flaw := flaw_of(layout):
        raise UnreadableCloud(f"NPY: {flaw}")
    check_count(layout.points, max_points, "this NPY")
    check_bytes(layout.size, len(data) - layout.body, "NPY")
    return RawCloud(to_xyz(memoryview(data)[layout.body :], layout), width=layout.width)


def of_points(xyz: bytes) -> bytes:
    """An NPY file of bare coordinates, (N, 3) float32, little-endian; what is left over of a point is left out."""
    facts = f"{{'descr': '<f4', 'fortran_order': False, 'shape': ({len(xyz) // 12}, 3), }}".encode()
    length = -(-(START + len(facts) + 1) // ALIGNED) * ALIGNED - START
    return b"".join((SIGNATURE, b"\x01\x00", length.to_bytes(2, "little"), facts.ljust(length - 1), b"\n", xyz))


def read_layout(head: bytes, where: str) -> Layout:
    """Reads an array's header from its first bytes.

    Raises:
        UnreadableCloud: it is none.
    """
    if layout := _read_usual(head):
        return layout
    stream = io.BytesIO(head)
    try:
        version = np.lib.format.read_magic(stream)
        # 3.0 differs from 2.0 in the encoding of field names alone, and x, y, z are the same in both.
        old = version == (1, 0)
        header = (np.lib.format.read_array_header_1_0 if old else np.lib.format.read_array_header_2_0)(stream)
    except Exception as error:  # NumPy evaluates a Python literal: half a dozen kinds, undocumented
        raise UnreadableCloud(
            f"{where} has no readable array header ({quote(str(error), 120)}); "
            "it is truncated or damaged: save it again with numpy.save"
        ) from error
    return Layout(header[2], header[0], header[1], stream.tell())


def _read_usual(head: bytes) -> Layout | None:
    """The layout of a plain array as NumPy writes it, without the parser of Python that NumPy reads it by."""
    said = _USUAL.match(head)
    if said is None or START + int.from_bytes(said["length"], "little") != said.end():
        return None
    shape = tuple(map(int, said["shape"].split(b",")))
    return Layout(np.dtype(said["type"].decode()), shape, said["fortran"] == b"True", said.end())


def flaw_of(layout: Layout) -> str:
    """Why an array is no cloud, or "" for one that is."""
    dtype, shape = layout.dtype, layout.shape
    if dtype.hasobject:
        return "it holds Python objects, which are never loaded; save plain numbers, of shape (N, 3)"
    if any(length < 0 for length in shape):
        return f"its shape {quote(shape)} is negative; the file is damaged"
    if dtype.names:
        fields = [dtype[axis] for axis in "xyz" if axis in dtype.names]
        if len(fields) == 3 and all(field.kind in "fiu" for field in fields):
            return ""
        return f"its fields {quote(dtype.names)} should have numbers x, y and z"
    if dtype.kind not in "fiu":
        return f"its values are of type {quote(str(dtype))}; a cloud is of floats or integers"
    if len(shape) not in (2, 3) or shape[-1] < 3:
        return f"its shape is {quote(shape)}; a cloud is (N, 3) or, organised, (H, W, 3), with further columns ignored"
    if shape[-1] > MOST_COLUMNS:
        return (
            f"its shape {quote(shape)} has {shape[-1]} columns, more than {MOST_COLUMNS}: is it a depth image, "
            "whose intrinsics should be given, or transposed? A cloud is (N, 3) or, organised, (H, W, 3)"
        )
    return ""


def to_xyz(octets: bytes | memoryview, layout: Layout) -> NDArray[np.float64]:
    """(N, 3) the points of an array without flaw, of whose data all bytes are there."""
    array = to_array(octets, layout)
    if layout.dtype.names:
        return np.stack([array[axis].ravel() for axis in "xyz"], axis=1, dtype=np.float64)
    return array[..., :3].astype(np.float64).reshape(-1, 3)


def to_array(octets: bytes | memoryview, layout: Layout) -> NDArray[Any]:
    """The array as it is, a view of its bytes, all of which are there."""
    flat = np.frombuffer(octets, layout.dtype, math.prod(layout.shape))
    return flat.reshape(layout.shape, order="F" if layout.fortran else "C")
