"""Rows of numbers in text, as ascii PCD, ascii PLY and xyz have them."""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, filterfalse, islice

import numpy as np
from numpy.typing import NDArray

from service.engine.errors import UnreadableCloud

LONGEST_LINE = 1 << 16  # bytes; numbers of a line are split up at twenty times their size


def filled_lines(body: bytes, where: str) -> Iterator[str]:
    """The lines of `body` that are not blank, of any line ending; latin-1, so that no byte fails.

    Raises:
        UnreadableCloud: a line is longer than any point.
    """
    body = body.replace(b"\r", b"\n")
    start = 0
    while len(body) - start > LONGEST_LINE:
        end = body.rfind(b"\n", start, start + LONGEST_LINE)
        if end < 0:
            raise UnreadableCloud(
                f"{where}: a line is longer than {LONGEST_LINE} bytes; write one point a line, each line ended"
            )
        start = end + 1
    return filter(str.strip, io.TextIOWrapper(io.BytesIO(body), encoding="latin-1", newline="\n"))


def read_rows(
    lines: Iterable[str],
    where: str,
    *,
    limit: int | None = None,
    columns: Sequence[int] | None = None,
    separator: str | None = None,
    comment: str | None = None,
) -> NDArray[np.float64]:
    """Reads rows of numbers; memory follows the text alone.

    Args:
        lines: consumed as far as `limit`.
        where: begins the message of an error.
        limit: how many rows to read; None for all.
        columns: which columns, where others may hold anything; None for all, and then every row must have as many.
        separator: one character; None for blanks.
        comment: one character that begins a comment.

    Returns:
        (R, C) float64: R is `limit`, or less where the text ends before.

    Raises:
        UnreadableCloud: a row is short or long, or holds something that is no number.
    """
    if comment is not None:
        lines = filterfalse(re.compile(rf"\s*{comment}").match, lines)  # such lines are no rows
    wanted = islice(lines, limit)
    first = next(wanted, None)
    if first is None:
        return np.empty((0, 0))
    try:
        return np.loadtxt(
            chain([first], wanted), comments=comment, delimiter=separator, usecols=columns, ndmin=2, dtype=np.float64
        )
    except ValueError as error:
        reason = str(error).partition("; use `usecols`")[0]
        raise UnreadableCloud(
            f"{where}: {reason[:200]} (rows counted from the first point, from 0); each line should hold "
            "the same columns of plain numbers such as -0.125 or 1e-3, nan where nothing was measured"
        ) from error


def check_rows(rows: int, promised: int, where: str) -> None:
    """Refuses a text with fewer rows than its header promises.

    Raises:
        UnreadableCloud: it ends early.
    """
    if rows < promised:
        raise UnreadableCloud(
            f"{where}: its header promises {promised} rows, but only {rows} follow; "
            "the file is truncated, or its header wrong: write or send it again"
        )
