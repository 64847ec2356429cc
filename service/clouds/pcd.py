"""PCD, the format of the Point Cloud Library: 0.7, and 0.5 and 0.6 where their headers say enough.

Written here because the readers on PyPI allocate what a header claims.
"""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from service.clouds.claims import check_bytes, check_count, check_unpacked, quote, whole_number
from service.clouds.frame import RawCloud, Viewpoint
from service.clouds.lzf import decompress
from service.clouds.text import check_rows, filled_lines, read_rows
from service.engine.errors import InvalidParameter, UnreadableCloud

HEADER_LIMIT = 1 << 16  # bytes
_DATA_LINE = re.compile(rb"^[ \t]*DATA[ \t]+(\S+)[ \t]*(?:\r?\n|\Z)", re.MULTILINE)


class Field(NamedTuple):
    """One field of a point: `values` of `size` bytes each; `kind` is F, I or U."""

    name: str
    size: int
    kind: str
    values: int


class Header(NamedTuple):
    """What the lines before the data say; the data begins at byte `body`. `width` is None where there is one row."""

    fields: tuple[Field, ...]
    points: int
    width: int | None
    viewpoint: Viewpoint | None
    encoding: str
    body: int

    @property
    def point_size(self) -> int:
        """Bytes of one point."""
        return sum(field.size * field.values for field in self.fields)


def read(data: bytes, max_points: int) -> RawCloud:
    """Reads x, y, z and the viewpoint of a PCD, organised or not.

    Raises:
        EmptyCloud, TooManyPoints: by the header's count of points.
        UnreadableCloud: the header contradicts itself, or the data that follows.
    """
    header = _read_header(data)
    check_count(header.points, max_points, "this PCD")
    columns = [_column(header.fields, axis) for axis in "xyz"]
    readers = {"ascii": _read_ascii, "binary": _read_binary, "binary_compressed": _read_compressed}
    if header.encoding not in readers:
        raise UnreadableCloud(f"PCD: DATA {quote(header.encoding)} is not one of {', '.join(readers)}")
    return RawCloud(readers[header.encoding](data, header, columns, max_points), header.viewpoint, width=header.width)


def _read_header(data: bytes) -> Header:
    end = _DATA_LINE.search(data[:HEADER_LIMIT])
    if end is None:
        raise UnreadableCloud(
            f"PCD: no DATA line in its first {min(len(data), HEADER_LIMIT)} bytes; "
            "the file is truncated in its header, or no PCD"
        )
    lines = [line.split() for line in data[: end.start()].decode("ascii", "replace").splitlines()]
    said = {words[0].upper(): words[1:] for words in lines if words and not words[0].startswith("#")}
    names = said.get("FIELDS", said.get("COLUMNS", []))
    points, width = _read_points(said)
    return Header(
        fields=_read_fields(names, said),
        points=points,
        width=width,
        viewpoint=_read_viewpoint(said["VIEWPOINT"]) if "VIEWPOINT" in said else None,
        encoding=end[1].decode("latin-1").lower(),
        body=end.end(),
    )


def _read_fields(names: list[str], said: dict[str, list[str]]) -> tuple[Field, ...]:
    sizes, kinds = said.get("SIZE", []), said.get("TYPE", [])
    counts = said.get("COUNT", ["1"] * len(names))
    if not names or not len(names) == len(sizes) == len(kinds) == len(counts):
        raise UnreadableCloud(
            f"PCD: its header names {len(names)} fields, {len(sizes)} sizes, {len(kinds)} types and {len(counts)} "
            "counts; FIELDS, SIZE, TYPE and COUNT should name as many each"
        )
    fields = tuple(
        Field(name.lower(), whole_number(size, "PCD: a SIZE"), kind.upper(), whole_number(count, "PCD: a COUNT"))
        for name, size, kind, count in zip(names, sizes, kinds, counts, strict=True)
    )
    for field in fields:
        if field.size not in (1, 2, 4, 8) or field.kind not in "FIU" or not field.values:
            raise UnreadableCloud(
                f"PCD: the field {quote(field.name)} has SIZE {field.size}, TYPE {quote(field.kind)}, COUNT "
                f"{field.values}; a size is 1, 2, 4 or 8 bytes, a type F, I or U, a count at least 1"
            )
    return fields


def _read_points(said: dict[str, list[str]]) -> tuple[int, int | None]:
    """How many points there are, and how many in a row where there are several rows."""
    sizes = {name: said[name] for name in ("WIDTH", "HEIGHT", "POINTS") if name in said}
    for name, words in sizes.items():
        if len(words) != 1:
            raise UnreadableCloud(f"PCD: {name} should be one number, not {quote(' '.join(words))}")
    numbers = {name: whole_number(words[0], f"PCD: {name}") for name, words in sizes.items()}
    if "WIDTH" not in numbers:
        if "POINTS" not in numbers:
            raise UnreadableCloud("PCD: its header says neither WIDTH and HEIGHT nor POINTS")
        return numbers["POINTS"], None
    grid = numbers["WIDTH"] * numbers.get("HEIGHT", 1)
    if numbers.get("POINTS", grid) != grid:
        raise UnreadableCloud(f"PCD: POINTS {numbers['POINTS']} is not WIDTH times HEIGHT, {grid}; correct its header")
    return grid, numbers["WIDTH"] if numbers.get("HEIGHT", 1) > 1 else None


def _read_viewpoint(words: list[str]) -> Viewpoint:
    try:
        numbers = [float(word) for word in words]
        if len(numbers) != 7:
            raise ValueError
        return Viewpoint(position=tuple(numbers[:3]), orientation=tuple(numbers[3:]))  # type: ignore[arg-type]  # 3, 4
    except (ValueError, InvalidParameter) as error:
        raise UnreadableCloud(
            f"PCD: VIEWPOINT {quote(' '.join(words))} should be tx ty tz qw qx qy qz, the sensor's position and a "
            "quaternion that is not zero: 0 0 0 1 0 0 0 where the sensor is the origin"
        ) from error


def _column(fields: tuple[Field, ...], axis: str) -> int:
    """Which of `fields` holds x, y or z."""
    for i, field in enumerate(fields):
        if field.name == axis:
            if field.values != 1 or (field.kind == "F" and field.size < 4):
                raise UnreadableCloud(f"PCD: the field {axis} should be one F of 4 or 8 bytes, not {tuple(field[1:])}")
            return i
    raise UnreadableCloud(
        f"PCD: none of its fields {quote([field.name for field in fields])} is {axis}; a cloud has x, y and z"
    )


def _read_ascii(data: bytes, header: Header, columns: list[int], max_points: int) -> NDArray[np.float64]:
    before = [sum(field.values for field in header.fields[:column]) for column in columns]
    width = sum(field.values for field in header.fields)
    check_bytes(header.points * 2 * width - 1, len(data) - header.body, "PCD ascii")  # a digit and a blank a value
    rows = read_rows(filled_lines(data[header.body :], "PCD ascii"), "PCD ascii", limit=header.points)
    check_rows(len(rows), header.points, "PCD ascii")
    if rows.shape[1] != width:
        raise UnreadableCloud(
            f"PCD ascii: its rows have {rows.shape[1]} columns, its header promises {width}; "
            "the file is truncated, or its header wrong"
        )
    return rows[:, before]


def _read_binary(data: bytes, header: Header, columns: list[int], max_points: int) -> NDArray[np.float64]:
    """Point after point."""
    size = header.point_size
    check_bytes(header.points * size, len(data) - header.body, "PCD binary")
    values = [
        np.ndarray(header.points, _dtype(header, column), data, header.body + _bytes_before(header, column), size)
        for column in columns
    ]
    return np.stack(values, axis=1, dtype=np.float64)


def _read_compressed(data: bytes, header: Header, columns: list[int], max_points: int) -> NDArray[np.float64]:
    """Field after field; only what reaches to the last of x, y, z is unpacked."""
    where = "PCD binary_compressed"
    check_bytes(8, len(data) - header.body, where)
    packed_size, size = (int(number) for number in np.frombuffer(data, "<u4", 2, header.body))
    if size != header.points * header.point_size:
        raise UnreadableCloud(
            f"{where}: its data unfolds to {size} bytes, but {header.points} points of {header.point_size} bytes "
            f"are {header.points * header.point_size}; the file is damaged, or its header wrong"
        )
    check_unpacked(size, max_points, where)
    start = header.body + 8
    check_bytes(packed_size, len(data) - start, where)
    needed = header.points * _bytes_before(header, max(columns) + 1)
    block = decompress(data[start : start + packed_size], needed, size, where)
    values = [
        np.ndarray(header.points, _dtype(header, column), block.data, header.points * _bytes_before(header, column))
        for column in columns
    ]
    return np.stack(values, axis=1, dtype=np.float64)


def _bytes_before(header: Header, column: int) -> int:
    """Bytes of one point before the field `column`."""
    return sum(field.size * field.values for field in header.fields[:column])


def _dtype(header: Header, column: int) -> np.dtype:
    """Little endian, as PCL writes on every machine that it runs on."""
    field = header.fields[column]
    return np.dtype(f"<{field.kind.lower()}{field.size}")
