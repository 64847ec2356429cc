"""Plain text, one point a line: x y z and whatever follows, separated by blanks, commas or semicolons.

`#` and `//` begin comments. A first line that is no point may name the columns, or, a lone number, count the points.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from service.clouds.claims import check_count, quote, whole_number
from service.clouds.frame import RawCloud
from service.clouds.text import LONGEST_LINE, check_rows, filled_lines, read_rows
from service.engine.errors import EmptyCloud, UnreadableCloud

_FILLED_LINE = re.compile(rb"^[^\S\n]*([^\s#][^\n#]*)", re.MULTILINE)


class Layout(NamedTuple):
    """What the first line tells: which columns are x, y, z, what separates them, where the points begin."""

    columns: tuple[int, ...]
    separator: str | None
    body: int
    promised: int | None = None


def read(data: bytes, max_points: int) -> RawCloud:
    """Reads the points of a text.

    Raises:
        EmptyCloud: no line but comments.
        TooManyPoints: more lines than `max_points`, or the first line promises more.
        UnreadableCloud: a line is no point, or there are fewer than promised.
    """
    if b"\0" in data:
        raise UnreadableCloud(
            "xyz: it holds zero bytes, so it is no plain text; send UTF-8 or ASCII text, or name another format"
        )
    text = data.removeprefix(b"\xef\xbb\xbf").replace(b"\r", b"\n").replace(b"//", b"#")
    layout = _read_layout(text)
    if layout.promised is not None:
        check_count(layout.promised, max_points, "the first line of this xyz")
    rows = read_rows(
        filled_lines(text[layout.body :], "xyz"),
        "xyz",
        limit=max_points + 1,
        columns=layout.columns,
        separator=layout.separator,
        comment="#" if b"#" in text else None,
    )
    check_count(len(rows), max_points, "this xyz" if len(rows) <= max_points else "the part of this xyz that was read")
    if layout.promised is not None:
        check_rows(len(rows), layout.promised, "xyz")
    return RawCloud(rows)


def _read_layout(text: bytes) -> Layout:
    line, start, after = _first_line(text, 0)
    promised = None
    if line.isascii() and line.isdigit():
        promised = whole_number(line, "xyz: the count in its first line")
        line, start, after = _first_line(text, after)
    columns = (0, 1, 2)
    words = [word.strip(" \t\"'").lower() for word in line.split(_separator(line))]
    if not any(map(_is_number, words[:3])):
        line, start, _ = _first_line(text, after)
        if {"x", "y", "z"} <= set(words):
            columns = (words.index("x"), words.index("y"), words.index("z"))
    width = len(line.split(_separator(line)))
    if width <= max(columns):
        raise UnreadableCloud(
            f"xyz: its first point {quote(line)} has {width} columns; "
            "a point is x y z, separated by blanks, commas or semicolons"
        )
    return Layout(columns, _separator(line), start, promised)


def _separator(line: str) -> str | None:
    """What stands between the columns of a line; None for blanks."""
    return next((sign for sign in ";," if sign in line), None)


def _first_line(text: bytes, start: int) -> tuple[str, int, int]:
    """The first line from `start` on that is no comment: its text, where it begins, where the next one begins."""
    line = _FILLED_LINE.search(text, start)
    if line is None:
        raise EmptyCloud("this xyz holds no points; send one point a line: x y z")
    return line[1][:LONGEST_LINE].decode("latin-1").strip(), line.start(), text.find(b"\n", line.end()) + 1 or len(text)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
