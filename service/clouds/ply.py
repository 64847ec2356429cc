"""PLY, the Stanford polygon format: points are its vertices; faces and other elements are passed over.

Written here because the readers on PyPI allocate what a header claims.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from types import MappingProxyType
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from service.clouds.claims import check_bytes, check_count, quote
from service.clouds.frame import RawCloud
from service.clouds.ply_header import Element, Header, read_header
from service.clouds.text import check_rows, filled_lines, read_rows
from service.engine.cloud import PointCloud
from service.engine.errors import UnreadableCloud

NOTHING: Mapping[str, Sequence[float]] = MappingProxyType({})


def read(data: bytes, max_points: int) -> RawCloud:
    """Reads x, y, z of a PLY's vertices.

    Raises:
        EmptyCloud, TooManyPoints: by the header's count of vertices.
        UnreadableCloud: the header is none, or the data ends before what it promises.
    """
    header = read_header(data)
    vertices = [element for element in header.elements if element.name == "vertex"]
    if len(vertices) != 1:
        names = quote([element.name for element in header.elements])
        raise UnreadableCloud(f"PLY: its elements {names} should have one vertex element, not {len(vertices)}")
    check_count(vertices[0].rows, max_points, "this PLY")
    columns = [_column(vertices[0], axis) for axis in "xyz"]
    reader = _read_binary if header.order else _read_ascii
    return RawCloud(reader(data, header, vertices[0], columns))


def write(
    cloud: PointCloud, index: NDArray[np.int32] | None = None, comments: Mapping[str, Sequence[float]] = NOTHING
) -> bytes:
    """A binary little-endian PLY that any viewer opens: x, y, z as float, metres, the camera at the origin.

    Args:
        cloud: whose points are written.
        index: (N,) a whole number for each point, its property `index`; None for none.
        comments: words of the header, each with its numbers.
    """
    said = "".join(f"comment {word} {' '.join(map(repr, numbers))}\n" for word, numbers in comments.items())
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"comment metres; camera at the origin: x right, y down, z forward\n{said}"
        f"element vertex {len(cloud.points)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"{'' if index is None else 'property int index' + chr(10)}end_header\n"
    )
    rows = cloud.points.astype("<f4").view("<u1").reshape(len(cloud.points), 12)
    if index is not None:
        rows = np.concatenate([rows, index.astype("<i4").view("<u1").reshape(len(index), 4)], axis=1)
    return header.encode() + rows.tobytes()


def _column(vertex: Element, axis: str) -> int:
    """Which property of a vertex is x, y or z."""
    for i, entry in enumerate(vertex.properties):
        if entry.name.lower() == axis and entry.length is None:
            return i
    names = quote([entry.name for entry in vertex.properties])
    raise UnreadableCloud(f"PLY: none of its vertex properties {names} is a number {axis}; a cloud has x, y and z")


def _read_ascii(data: bytes, header: Header, vertex: Element, columns: list[int]) -> NDArray[np.float64]:
    where = "PLY ascii"
    present = len(data) - header.body
    for element in header.elements:
        check_bytes(element.rows * 2 * len(element.properties) - 1, present, where)  # a digit and a blank a value
    lines = filled_lines(data[header.body :], where)
    xyz = np.empty((0, 3))
    for element in header.elements:
        if not element.properties:
            continue
        if element is not vertex:
            check_rows(sum(1 for _ in islice(lines, element.rows)), element.rows, f"{where}, {quote(element.name)}")
            continue
        wanted = lines if not element.has_lists else _without_lists(lines, element)
        rows = read_rows(wanted, where, limit=element.rows)
        check_rows(len(rows), element.rows, where)
        scalars = [i for i, entry in enumerate(element.properties) if entry.length is None]
        if rows.shape[1] != len(scalars):
            raise UnreadableCloud(
                f"{where}: its vertices have {rows.shape[1]} columns, its header promises {len(scalars)}; "
                "the file is truncated, or its header wrong"
            )
        xyz = rows[:, [scalars.index(column) for column in columns]]
    return xyz


def _without_lists(lines: Iterator[str], element: Element) -> Iterator[str]:
    """The rows of an element with its lists cut out."""
    for row, line in enumerate(lines):
        words = line.split()
        kept = []
        at = 0
        for entry in element.properties:
            word = words[at] if at < len(words) else ""
            if entry.length is None:
                kept.append(word)
            elif not (word.isascii() and word.isdigit() and len(word) < 10):
                raise UnreadableCloud(f"PLY ascii: the list {quote(entry.name)} of row {row} has no length")
            at += 1 + (int(word) if entry.length is not None else 0)
        if at != len(words):
            raise UnreadableCloud(
                f"PLY ascii: row {row} of {quote(element.name)} has {len(words)} numbers, not {at}; is it truncated?"
            )
        yield " ".join(kept)


def _read_binary(data: bytes, header: Header, vertex: Element, columns: list[int]) -> NDArray[np.float64]:
    at = header.body
    xyz = np.empty((0, 3))
    for element in header.elements:
        where = f"PLY binary, {quote(element.name)}"
        check_bytes(element.rows * element.smallest_row, len(data) - at, where)
        if not element.has_lists:
            if element is vertex:
                xyz = _fixed_rows(data, at, element, columns)
            at += element.rows * element.smallest_row
            continue
        wanted = columns if element is vertex else []
        places, at = _walk_rows(data, at, element, np.array(wanted, np.int64), header.order == ">")
        if at < 0:
            raise UnreadableCloud(
                f"{where}: its lists do not fit into the {len(data)} bytes of the file; "
                "the file is truncated or damaged: write or send it again"
            )
        if element is vertex:
            xyz = _scattered_rows(data, places, element, columns)
    return xyz


def _fixed_rows(data: bytes, start: int, element: Element, columns: list[int]) -> NDArray[np.float64]:
    """(rows, columns) values of an element without lists, whose rows all have one length."""
    before = np.cumsum([0] + [entry.type.itemsize for entry in element.properties])
    first = element.properties[columns[0]].type
    if columns == list(range(columns[0], columns[0] + len(columns))) and all(
        element.properties[c].type == first for c in columns
    ):
        place, strides = start + int(before[columns[0]]), (element.smallest_row, first.itemsize)
        return np.ndarray((element.rows, len(columns)), first, data, place, strides).astype(np.float64)
    values = [
        np.ndarray(element.rows, element.properties[c].type, data, start + int(before[c]), element.smallest_row)
        for c in columns
    ]
    return np.stack(values, axis=1, dtype=np.float64)


def _scattered_rows(
    data: bytes, places: NDArray[np.int64], element: Element, columns: list[int]
) -> NDArray[np.float64]:
    """(rows, columns) values that begin at byte `places` (rows, columns)."""
    octets = np.frombuffer(data, np.uint8)
    values = []
    for place, column in zip(places.T, columns, strict=True):
        kind = element.properties[column].type
        values.append(octets[place[:, None] + np.arange(kind.itemsize)].view(kind)[:, 0])
    return np.stack(values, axis=1, dtype=np.float64)


def _walk_rows(
    data: bytes, start: int, element: Element, wanted: NDArray[np.int64], big: bool
) -> tuple[NDArray[np.int64], int]:
    """Where the `wanted` properties of each row begin, (rows, wanted), and the element's end: -1 if past the data."""
    sizes = np.array([entry.type.itemsize for entry in element.properties], np.int64)
    lengths = np.array([entry.length.itemsize if entry.length else 0 for entry in element.properties], np.int64)
    places = np.empty((element.rows if len(wanted) else 0, len(wanted)), np.int64)
    end = _walk(np.frombuffer(data, np.uint8), start, element.rows, sizes, lengths, wanted, big, places)
    return places, end


@njit(cache=True, nogil=True)
def _walk(
    data: NDArray[np.uint8],
    start: int,
    rows: int,
    sizes: NDArray[np.int64],
    lengths: NDArray[np.int64],
    wanted: NDArray[np.int64],
    big: bool,
    places: NDArray[np.int64],
) -> int:
    """Steps from row to row: each list's length is in its `lengths` leading bytes (0: no list)."""
    at = start
    for row in range(rows):
        for i in range(sizes.size):
            for k in range(wanted.size):
                if wanted[k] == i:
                    places[row, k] = at
            step = sizes[i]
            if lengths[i]:
                if at + lengths[i] > data.size:
                    return -1
                items = 0
                for k in range(lengths[i]):
                    octet: Any = np.int64(data[at + (k if big else lengths[i] - 1 - k)])
                    items = (items << 8) | octet
                step = lengths[i] + items * sizes[i]
                if items < 0 or items > data.size:
                    return -1
            at += step
            if at > data.size:
                return -1
    return at
