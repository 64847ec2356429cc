"""What headers promise, against limits and bytes."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.clouds.claims import check_bytes, check_count, check_unpacked, quote, whole_number
from service.engine.errors import EmptyCloud, TooManyPoints, UnreadableCloud


@given(st.integers(0, 10**39))
def test_whole_numbers_are_read_as_written(number: int):
    assert whole_number(str(number), "test") == number


@pytest.mark.parametrize("text", ["", "-1", "+1", "1.0", "1e3", "1_000", " 1", "0x10", "٣", "²", "9" * 5000])
def test_other_spellings_of_a_count_are_refused(text: str):
    with pytest.raises(UnreadableCloud, match="test should be a whole number"):
        whole_number(text, "test")


def test_limits_are_inclusive():
    check_count(5, 5, "test")
    check_bytes(5, 5, "test")
    with pytest.raises(TooManyPoints, match="6 points"):
        check_count(6, 5, "test")
    with pytest.raises(UnreadableCloud, match="truncated"):
        check_bytes(6, 5, "test")
    with pytest.raises(EmptyCloud):
        check_count(0, 5, "test")


def test_data_may_unfold_in_proportion_to_the_limit_on_points():
    check_unpacked(64 * 5_000_000, 5_000_000, "test")
    with pytest.raises(TooManyPoints):
        check_unpacked(64 * 5_000_000, 1_000_000, "test")


@given(st.text() | st.binary())
def test_a_quotation_is_short(given_text: str | bytes):
    assert len(quote(given_text)) <= 63
