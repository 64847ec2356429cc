"""The header of a PLY file: which elements follow, and what each of their rows holds."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from service.clouds.claims import quote, whole_number
from service.engine.errors import UnreadableCloud

HEADER_LIMIT = 1 << 16  # bytes
ENCODINGS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}  # and NumPy's sign for the byte order
_END = re.compile(rb"^[ \t]*end_header[ \t]*(\r\n|\n|\r|\Z)", re.MULTILINE)
_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "int64": "i8",
    "uint64": "u8", "float": "f4", "double": "f8", "float32": "f4", "float64": "f8",
}  # fmt: skip


class Property(NamedTuple):
    """One value of a row, or, with a `length` type, a list that begins with its length."""

    name: str
    type: np.dtype
    length: np.dtype | None = None


class Element(NamedTuple):
    """`rows` rows, each of these properties."""

    name: str
    rows: int
    properties: tuple[Property, ...]

    @property
    def has_lists(self) -> bool:
        """Whether rows may differ in length."""
        return any(entry.length is not None for entry in self.properties)

    @property
    def smallest_row(self) -> int:
        """Bytes of a row whose lists are all empty."""
        return sum((entry.length or entry.type).itemsize for entry in self.properties)


class Header(NamedTuple):
    """The elements in their order in the file; `order` is NumPy's byte order, "" for ascii; data begins at `body`."""

    order: str
    elements: tuple[Element, ...]
    body: int


def read_header(data: bytes) -> Header:
    """Reads a PLY's header.

    Raises:
        UnreadableCloud: it does not end, or is none.
    """
    end = _END.search(data[:HEADER_LIMIT].replace(b"\r", b"\n") if _old_mac(data) else data[:HEADER_LIMIT])
    if not data.startswith(b"ply") or end is None:
        raise UnreadableCloud(
            f"PLY: no header from 'ply' to 'end_header' in its first {min(len(data), HEADER_LIMIT)} bytes; "
            "the file is truncated in its header, or no PLY"
        )
    order: str | None = None
    elements: list[Element] = []
    for line in data[: end.start()].decode("ascii", "replace").splitlines()[1:]:
        match line.split():
            case [] | ["comment" | "obj_info", *_]:
                pass
            case ["format", encoding, _] if encoding in ENCODINGS and order is None:
                order = ENCODINGS[encoding]
            case ["element", name, rows] if order is not None:
                elements.append(Element(name, whole_number(rows, f"PLY: the count of {quote(name)}"), ()))
            case ["property", *words] if elements:
                last = elements[-1]
                elements[-1] = last._replace(properties=(*last.properties, _read_property(words, order or "")))
            case _:
                raise UnreadableCloud(f"PLY: its header has a line that does not belong there: {quote(line)}")
    if order is None:
        raise UnreadableCloud(f"PLY: its header names no format; it is one of {', '.join(ENCODINGS)}")
    return Header(order, tuple(elements), end.end())


def _old_mac(data: bytes) -> bool:
    """Whether lines end with a carriage return alone."""
    return data[3:4] == b"\r" and data[4:5] != b"\n"


def _read_property(words: list[str], order: str) -> Property:
    match words:
        case ["list", count, kind, name] if count in _TYPES and kind in _TYPES and _TYPES[count][0] != "f":
            return Property(name, np.dtype(order + _TYPES[kind]), np.dtype(order + _TYPES[count]))
        case [kind, name] if kind in _TYPES:
            return Property(name, np.dtype(order + _TYPES[kind]))
    raise UnreadableCloud(
        f"PLY: its header has a property {quote(' '.join(words))}; it should be a type and a name, or list, "
        f"an integer type, a type and a name, with types {', '.join(_TYPES)}"
    )
