"""Cron expressions: minute, hour, day of month, month and day of week, by the clock of a time zone."""

from __future__ import annotations

import re
from datetime import UTC, datetime, tzinfo
from typing import Any, NamedTuple
from zoneinfo import ZoneInfo

from service.engine.errors import InvalidParameter, JobsUnavailable

FIELDS = ("minute", "hour", "day of month", "month", "day of week")
_VALUE = r"([0-9]{1,2}|[A-Za-z]{3})"
_ITEM = rf"(\*|{_VALUE}(-{_VALUE})?)(/[0-9]{{1,3}})?"
_FIELD = re.compile(rf"{_ITEM}(,{_ITEM})*")
LONGEST = 200  # characters


class Cron(NamedTuple):
    """Times that return.

    Attributes:
        expression: five fields, as `FIELDS`.
        zone: IANA name of the time zone, as Europe/Berlin. A time that its clock jumps over comes when it jumps, and
            one that it shows twice comes twice.
    """

    expression: str
    zone: str

    def last(self, now: datetime) -> datetime:
        """The latest of the times that is not later than a moment; UTC."""
        before: datetime = self._from(now).get_current(datetime)
        if self._is_due(before):
            return before.astimezone(UTC)
        found: datetime = self._from(now).get_prev(datetime)
        return found.astimezone(UTC)

    def next(self, now: datetime) -> datetime:
        """The earliest of the times that is later than a moment; UTC."""
        found: datetime = self._from(now).get_next(datetime)
        return found.astimezone(UTC)

    def _from(self, now: datetime) -> Any:
        moment = now.astimezone(_zone(self.zone)).replace(microsecond=0)
        return _croniter()(self.expression, moment)

    def _is_due(self, moment: datetime) -> bool:
        return moment.second == 0 and bool(_croniter().match(self.expression, moment))


def read_cron(expression: str, zone: str = "UTC") -> Cron:
    """The times that an expression means.

    Raises:
        InvalidParameter: it is no such expression, or never comes, or the time zone is not known.
        JobsUnavailable: what jobs need is not installed.
    """
    fields = expression.split()
    if len(expression) > LONGEST or len(fields) != len(FIELDS) or not all(map(_FIELD.fullmatch, fields)):
        raise InvalidParameter(
            f"'{expression[:60]}' is no cron expression: five fields, {', '.join(FIELDS)}, as '0 3 * * mon' for every "
            "Monday at 03:00."
        )
    try:
        _zone(zone)
    except (OSError, ValueError, LookupError) as error:  # no such file, no such key, or an empty one
        raise InvalidParameter(f"There is no time zone '{zone[:60]}': write UTC or as Europe/Berlin.") from error
    cron = Cron(" ".join(fields).lower(), zone)
    try:
        cron.next(datetime.now(UTC))
    except ValueError as error:  # croniter's errors are
        raise InvalidParameter(f"The cron expression '{expression[:60]}' means no time: {error}.") from error
    return cron


def _zone(name: str) -> tzinfo:
    return UTC if name == "UTC" else ZoneInfo(name)


def _croniter() -> Any:
    try:
        from croniter import croniter
    except ImportError as error:
        raise JobsUnavailable("Schedules need DBOS: pip install 'shape-concepts[jobs]'.") from error
    return croniter
