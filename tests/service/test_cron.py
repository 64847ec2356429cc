"""Times that return, by the clock of a time zone."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.cron import Cron, read_cron
from service.engine.errors import InvalidParameter


def at(text: str) -> datetime:
    return datetime.fromisoformat(text).replace(tzinfo=UTC)


def test_a_time_is_due_at_its_minute_and_stays_the_last_until_the_next() -> None:
    cron = read_cron("*/5 * * * *")
    assert cron.last(at("2026-01-01T00:04:59.9")) == at("2026-01-01T00:00:00")
    assert cron.last(at("2026-01-01T00:05:00")) == at("2026-01-01T00:05:00")
    assert cron.last(at("2026-01-01T00:05:00.5")) == at("2026-01-01T00:05:00")
    assert cron.next(at("2026-01-01T00:05:00")) == at("2026-01-01T00:10:00")


@given(
    st.sampled_from(["* * * * *", "*/7 3,15 * * *", "0 3 * * mon", "30 2 1 */2 *", "59 23 29 2 *"]),
    st.sampled_from(["UTC", "Europe/Berlin", "Asia/Kathmandu"]),
    st.datetimes(datetime(2024, 1, 1), datetime(2030, 1, 1)),
)
def test_the_last_time_is_not_later_than_now_and_none_lies_between(expression: str, zone: str, now: datetime) -> None:
    cron, moment = read_cron(expression, zone), now.replace(tzinfo=UTC)
    last = cron.last(moment)
    assert last <= moment < cron.next(moment)
    assert cron.next(last) > moment or cron.next(last) == cron.next(moment)
    assert cron.last(cron.next(moment)) == cron.next(moment)


def test_it_goes_by_the_clock_of_the_zone_in_summer_and_winter() -> None:
    cron = read_cron("0 3 * * *", "Europe/Berlin")
    assert cron.next(at("2026-01-10T12:00")) == at("2026-01-11T02:00")
    assert cron.next(at("2026-07-10T12:00")) == at("2026-07-11T01:00")


def test_a_time_that_the_clock_jumps_over_comes_when_it_jumps() -> None:
    cron = read_cron("30 2 * * *", "Europe/Berlin")
    assert cron.next(at("2026-03-29T00:00")) == at("2026-03-29T01:00")  # 03:00 of summer
    assert cron.next(at("2026-03-29T01:00")) - at("2026-03-29T01:00") < timedelta(days=1)


def test_names_of_days_and_spaces_are_understood() -> None:
    assert read_cron(" 0  3 * * MON-fri ") == Cron("0 3 * * mon-fri", "UTC")


@pytest.mark.parametrize(
    "expression",
    [
        *("", "soon", "* * * *", "* * * * * *", "60 * * * *", "*/0 * * * *", "0 0 30 2 *", "R R * * *", "H * * * *"),
        *("@daily", "0 3 * * xyz", "0 3 * * mon" + ",mon" * 100, "-1 * * * *", "0 3 * * 1;", "1e3 * * * *"),
    ],
)
def test_what_means_no_time_or_another_one_each_time_is_refused(expression: str) -> None:
    with pytest.raises(InvalidParameter, match="cron expression"):
        read_cron(expression)


@pytest.mark.parametrize("zone", ["", "Mars/Olympus", "../../etc/passwd", "Europe", "/etc/passwd", "a\x00b"])
def test_what_is_no_time_zone_is_refused(zone: str) -> None:
    with pytest.raises(InvalidParameter, match="time zone"):
        read_cron("0 3 * * *", zone)
