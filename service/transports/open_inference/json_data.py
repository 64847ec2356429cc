"""The numbers of a tensor in JSON, read apart from the document around them.

A parser makes many bytes of memory of one byte of JSON, and lets no other thread have its turn meanwhile. So the list
of the numbers is cut out unread, and read piece by piece when it is known how many there should be.
"""

from __future__ import annotations

import json
import re
import secrets
from collections.abc import Iterator
from types import NoneType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from service.clouds.claims import quote
from service.engine.errors import UnreadableCloud

LONGEST = 1 << 16  # bytes of the document without the numbers
PIECE = 1 << 13  # bytes parsed at a time
_DATA = re.compile(rb'"data"[ \t\r\n]*:[ \t\r\n]*(?=\[)')
_COMMA = re.compile(rb"[ \t\r\n]*,")
_WHAT = "the data of a tensor is [x, y, z, x, y, z, ...] or [[x, y, z], ...]"


class Cut(NamedTuple):
    """A document whose first member `data` was cut out.

    Attributes:
        document: the rest, with a text in place of the numbers.
        text: that text; no client can guess it.
        start: where the list begins in the whole.
        end: where it ends.
    """

    document: bytes
    text: str
    start: int
    end: int


def cut_out(whole: bytes, end: int) -> Cut:
    """Cuts the list `data` out of the JSON document that is the first `end` bytes.

    Raises:
        UnreadableCloud: the rest is too long.
    """
    text = secrets.token_hex(16)
    found = _DATA.search(whole, 0, min(end, LONGEST))
    start = stop = end
    document = b""
    if found is not None:
        start = found.end()
        # No number has a quote or a brace: where the next one stands, the list is over.
        marks = [at for mark in (b'"', b"}") if (at := whole.find(mark, start, end)) >= 0]
        stop = whole.rfind(b"]", start, min(marks, default=end)) + 1
        if stop <= start:
            raise UnreadableCloud(f"The list 'data' in the JSON is cut off, or not of numbers: {_WHAT}.")
        document = b'"%b"' % text.encode()
    length = start + end - stop
    if length > LONGEST:
        raise UnreadableCloud(
            f"The JSON is {length} bytes long beside its list of numbers, more than {LONGEST}; {_WHAT}."
        )
    return Cut(whole[:start] + document + whole[stop:end], text, start, stop)


def read_numbers(whole: bytes, cut: Cut, count: int) -> NDArray[np.float32]:
    """The numbers of a list that was cut out (`count`,), row after row; NaN for null.

    Raises:
        UnreadableCloud: the list is none of numbers or of rows of three, or has not as many.
    """
    start, end = cut.start + 1, cut.end - 1
    if count > end - start:  # before memory is taken for them
        raise _other_count(f"at most {end - start}", count)
    numbers = np.empty(count, np.float32)
    rows = whole[start : start + PIECE].lstrip(b" \t\r\n").startswith(b"[")
    filled = 0
    for piece in _pieces(whole, start, end, rows):
        part = _parse(piece, rows, filled)
        if filled + len(part) > count:
            raise _other_count(f"more than {count}", count)
        numbers[filled : filled + len(part)] = part
        filled += len(part)
    if filled < count:
        raise _other_count(str(filled), count)
    return numbers


def _pieces(whole: bytes, start: int, end: int, rows: bool) -> Iterator[bytes]:
    """The text between two places, cut where a number or a row ends."""
    begun = start
    while end - start > PIECE:
        cut = whole.rfind(b"]" if rows else b",", start, start + PIECE) + rows
        comma = _COMMA.match(whole, cut, end)
        if cut <= start or comma is None:
            raise UnreadableCloud(f"JSON: {quote(whole[start : start + 20])} is not as it should be; {_WHAT}.")
        yield whole[start:cut]
        start = comma.end()
    last = whole[start:end]
    if start > begun and not last.strip():
        raise UnreadableCloud(f"JSON: a comma is one too many at the end of the list; {_WHAT}.")
    yield last


def _parse(piece: bytes, rows: bool, before: int) -> NDArray[np.float32]:
    """The numbers of a piece; `before` of them came before."""
    try:
        values = json.loads(b"[%b]" % piece, parse_int=float)
    except (ValueError, RecursionError) as error:
        raise UnreadableCloud(f"JSON: {quote(str(error), 100)} after its first {before} numbers; {_WHAT}.") from error
    if rows:
        for row in values:
            if not isinstance(row, list) or len(row) != 3:
                raise UnreadableCloud(f"JSON: {quote(row)} after its first {before} numbers; {_WHAT}.")
        values = [value for row in values for value in row]
    if not {type(value) for value in values} <= {float, NoneType}:
        raise UnreadableCloud(f"JSON: not all is numbers after the first {before} of them; {_WHAT}.")
    given = np.array(values, np.float64)
    with np.errstate(over="ignore"):
        numbers = given.astype(np.float32)
    if (np.isinf(numbers) & np.isfinite(given)).any():
        raise UnreadableCloud(f"JSON: a number after the first {before} is beyond any that FP32 has.")
    return numbers


def _other_count(found: str, count: int) -> UnreadableCloud:
    return UnreadableCloud(f"The tensor should have {count} numbers by its shape; its data has {found}.")
