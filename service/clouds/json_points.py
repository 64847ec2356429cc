"""JSON: a list of points [x, y, z], or an object that has it as "points", beside "unit" and "viewpoint".

null, for a point or a coordinate, is what was not measured. A JSON parser makes twenty bytes of memory of one byte of
`[],[],`: so the text is surveyed first, the rest of it read piece by piece, and only of bytes that points can be of.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray
from pydantic_core import from_json

from service.clouds.claims import check_count, quote
from service.clouds.frame import UNITS, RawCloud, Viewpoint
from service.engine.errors import InvalidParameter, UnreadableCloud

PIECE = 1 << 13  # bytes parsed at a time, so that other threads have their turn in between; no point is as long
MEMBERS = ("points", "unit", "viewpoint")
_BLANK = re.compile(rb"[ \t\r\n]*")
_COMMA = re.compile(rb"[ \t\r\n]*,")
_MEMBER = re.compile(rb'"((?:[^"\\]|\\.){0,60})"[ \t\r\n]*:[ \t\r\n]*', re.DOTALL)
_SMALL_VALUE = re.compile(rb'"[^"\\]{0,60}"|null|\[[-+.\deE, \t\r\n]{0,600}\]')
_OPEN, _CLOSE, _SEPARATOR = b"[],"
_OF_POINTS = np.isin(np.arange(256), np.frombuffer(b"[]0123456789+-.eE,nul \t\r\n", np.uint8))
_NOT_MEASURED = (None, None, None)
_WHAT = 'a cloud is [[x, y, z], ...] or {"points": [[x, y, z], ...]}, with null where nothing was measured'


def read(data: bytes, max_points: int) -> RawCloud:
    """Reads the points of a JSON text, and its own word on their unit and on the viewpoint.

    Raises:
        EmptyCloud, TooManyPoints: by the length of the list.
        UnreadableCloud: no JSON, or none of a cloud.
    """
    text = data.removeprefix(b"\xef\xbb\xbf")
    at = _skip(_BLANK, text, 0)
    if text[at : at + 1] == b"[":
        xyz, at = _read_points(text, at, max_points)
        said: dict[str, Any] = {"points": xyz}
    else:
        said, at = _read_object(text, at, max_points)
    if (at := _skip(_BLANK, text, at)) < len(text):
        raise UnreadableCloud(f"JSON: {quote(text[at : at + 20])} follows its end; send one cloud at a time")
    if "points" not in said:
        raise UnreadableCloud(f"JSON: its object has no member 'points'; {_WHAT}")
    return RawCloud(said["points"], _viewpoint(said.get("viewpoint")), _unit(said.get("unit")))


def _read_object(text: bytes, at: int, max_points: int) -> tuple[dict[str, Any], int]:
    """The members of the object that begins at byte `at`, and where it ends."""
    if text[at : at + 1] != b"{":
        raise _unexpected(text, at, "a list or an object")
    said: dict[str, Any] = {}
    at = _skip(_BLANK, text, at + 1)
    while text[at : at + 1] != b"}":
        if said:
            at = _skip(_BLANK, text, _skip(_COMMA, text, at))
        member = _MEMBER.match(text, at)
        if member is None:
            raise _unexpected(text, at, f"one of the members {', '.join(MEMBERS)}")
        name, at = member[1].decode("latin-1"), member.end()
        if name not in MEMBERS or name in said:
            problem = "appears twice" if name in said else f"is unknown; there are {', '.join(MEMBERS)}"
            raise UnreadableCloud(f"JSON: its member {quote(name)} {problem}")
        if name == "points":
            said[name], at = _read_points(text, at, max_points)
        else:
            said[name], at = _read_small(text, at, name)
        at = _skip(_BLANK, text, at)
    return said, at + 1


def _read_small(text: bytes, at: int, name: str) -> tuple[Any, int]:
    """The short value of a member, and where it ends."""
    value = _SMALL_VALUE.match(text, at)
    try:
        if value is not None:
            return json.loads(value[0], parse_int=float), value.end()
    except ValueError:
        pass
    raise _unexpected(text, at, f"the value of {quote(name)}: a short string, a list of numbers, or null")


def _unit(given: Any) -> str | None:
    if given is None or (isinstance(given, str) and given in UNITS):
        return given
    raise UnreadableCloud(f"JSON: its unit {quote(given)} is unknown; it is one of {', '.join(UNITS)}")


def _viewpoint(given: Any) -> Viewpoint | None:
    if given is None:
        return None
    try:
        if not isinstance(given, list) or len(given) not in (3, 7):
            raise InvalidParameter
        return Viewpoint(*(tuple(part) for part in (given[:3], given[3:]) if part))
    except InvalidParameter as error:
        raise UnreadableCloud(
            f"JSON: its viewpoint {quote(given)} should be [x, y, z] or [x, y, z, qw, qx, qy, qz], the sensor's "
            "position and a quaternion that is not zero"
        ) from error


def _read_points(text: bytes, at: int, max_points: int) -> tuple[NDArray[np.float64], int]:
    """The (N, 3) points of the list that begins at byte `at`, and where it ends."""
    if text[at : at + 1] != b"[":
        raise _unexpected(text, at, "a list of points")
    end, commas, sound = _survey(np.frombuffer(text, np.uint8), at, _OF_POINTS)
    if not sound:
        raise _unexpected(text, end, "a part of a list of points")
    count = commas + (commas > 0 or _skip(_BLANK, text, at + 1) < end - 1)
    check_count(count, max_points, "this JSON")
    xyz = np.empty((count, 3))
    filled = 0
    for piece in _pieces(text, at + 1, end - 1):
        points = _parse(piece, filled)
        xyz[filled : filled + len(points)] = points
        filled += len(points)
    if filled < count:
        raise UnreadableCloud(f"JSON: a comma is one too many after its {filled} points; {_WHAT}")
    return xyz, end


@njit(cache=True, nogil=True)
def _survey(text: NDArray[np.uint8], start: int, of_points: NDArray[np.bool_]) -> tuple[int, int, bool]:
    """Where the list that begins at `start` ends, its own commas, and True; or where it goes wrong, and False."""
    depth = 0
    commas = 0
    for at in range(start, text.size):
        octet = text[at]
        if not of_points[octet]:
            return at, commas, False
        if octet == _OPEN:
            depth += 1
            if depth > 2:
                return at, commas, False
        elif octet == _CLOSE:
            depth -= 1
            if depth == 0:
                return at + 1, commas, True
        elif octet == _SEPARATOR and depth == 1:
            commas += 1
    return text.size, commas, False


def _pieces(text: bytes, start: int, end: int) -> Iterator[bytes]:
    """The text between two places, cut between points."""
    while end - start > PIECE:
        cut = text.rfind(b"]", start, start + PIECE) + 1
        if not cut:  # nulls alone, up to the point that may begin there
            opened = text.find(b"[", start, start + PIECE)
            null = text.rfind(b"null", start, opened if opened >= 0 else start + PIECE)
            cut = null + 4 if null >= 0 else start
        if cut <= start:
            raise _unexpected(text, start, f"a point in less than {PIECE} bytes")
        yield text[start:cut]
        start = _skip(_COMMA, text, cut)
    if start < end:
        yield text[start:end]


def _parse(piece: bytes, before: int) -> NDArray[np.float64]:
    """(K, 3) the points of a piece, NaN where null; `before` of them came before."""
    xyz = _parse_plain(piece)
    return _parse_any(piece, before) if xyz is None else xyz


def _parse_plain(piece: bytes) -> NDArray[np.float64] | None:
    """The points of a piece that are three finite numbers each, or null, in half the time; None where one is not."""
    try:
        xyz = np.array(from_json(b"[%b]" % piece, allow_inf_nan=False), np.float64)
    except (ValueError, OverflowError, TypeError):
        return None
    return xyz if xyz.ndim == 2 and xyz.shape[1] == 3 and not np.isinf(xyz).any() else None


def _parse_any(piece: bytes, before: int) -> NDArray[np.float64]:
    """As `_parse`, with points that are null as a whole, and with an error that says what is wrong."""
    try:
        points = json.loads(b"[%b]" % piece, parse_int=float)
    except ValueError as error:
        raise UnreadableCloud(f"JSON: {quote(str(error), 100)} after its first {before} points; {_WHAT}") from error
    points = [_NOT_MEASURED if point is None else point for point in points]
    for number, point in enumerate(points, before):
        if not isinstance(point, (list, tuple)) or len(point) != 3:
            raise UnreadableCloud(f"JSON: its point {number}, counted from 0, is {quote(point)}; {_WHAT}")
    xyz = np.array(points, np.float64).reshape(-1, 3)
    if np.isinf(xyz).any():
        raise UnreadableCloud(
            f"JSON: one of its points {before} to {before + len(points) - 1} has a number beyond any; "
            "null stands for what was not measured"
        )
    return xyz


def _skip(expected: re.Pattern[bytes], text: bytes, at: int) -> int:
    """Where what is expected at byte `at` ends."""
    found = expected.match(text, at)
    if found is None:
        raise _unexpected(text, at, "a comma or an end")
    return found.end()


def _unexpected(text: bytes, at: int, expected: str) -> UnreadableCloud:
    """What is wrong at byte `at`."""
    if at >= len(text):
        return UnreadableCloud(f"JSON: it ends where {expected} should follow; it is truncated: send it again")
    return UnreadableCloud(f"JSON: {quote(text[at : at + 20])} at byte {at} should be {expected}; {_WHAT}")
