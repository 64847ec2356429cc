"""Rows of numbers in text."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.clouds.text import LONGEST_LINE, filled_lines, read_rows
from service.engine.errors import UnreadableCloud

rows = st.integers(1, 5).flatmap(
    lambda width: st.lists(st.lists(st.floats(), min_size=width, max_size=width), min_size=1, max_size=20)
)


@settings(deadline=None, derandomize=True)
@given(rows, st.sampled_from(["\n", "\r\n", "\r", "\n \n\n"]))
def test_numbers_are_read_as_python_writes_them(numbers: list[list[float]], ending: str):
    body = ending.join(" ".join(map(repr, row)) for row in numbers).encode()
    assert np.array_equal(read_rows(filled_lines(body, "test"), "test"), numbers, equal_nan=True)


def test_no_more_lines_are_taken_than_wanted():
    lines = filled_lines(b"1 2\n\n3 4\n5 6\n", "test")
    assert read_rows(lines, "test", limit=2).tolist() == [[1, 2], [3, 4]]
    assert next(lines) == "5 6\n"


def test_no_lines_are_no_rows():
    assert len(read_rows(filled_lines(b"\n \n", "test"), "test")) == 0


@pytest.mark.parametrize("before", [b"", b"1 2 3\n" * 50_000, b"1 " * 30_000 + b"\n"])
def test_a_line_without_end_is_refused_wherever_it_stands(before: bytes):
    longest = b"1 " * (LONGEST_LINE // 2 - 1)
    filled_lines(before + longest + b"\n" + longest, "test")
    with pytest.raises(UnreadableCloud, match="longer than"):
        filled_lines(before + longest + b"1 2 3\n4", "test")
