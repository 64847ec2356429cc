"""Schedules as tables, for people at a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from service.schedules import Schedule


def show_schedules(schedules: Sequence[Schedule]) -> None:
    """Prints schedules, a row each."""
    table = Table()
    for heading in ("schedule", "state", "times", "job", "next due (UTC)", "last job"):
        table.add_column(heading)
    for schedule in schedules:
        work = f"{schedule.job.kind} {getattr(schedule.job, 'name', '')}".strip()
        last = schedule.fault or schedule.last_job or "-"
        times = f"{schedule.cron} {schedule.zone}"
        table.add_row(schedule.name, schedule.state, times, work, _time(schedule.next_due), escape(last))
    Console().print(table)


def show_schedule(schedule: Schedule) -> None:
    """Prints a schedule with all that is known of it."""
    table = Table(title=f"schedule {schedule.name}", title_justify="left", title_style="bold", show_header=False)
    rows = {
        "state": schedule.state,
        "times": f"{schedule.cron} {schedule.zone}",
        "since": _time(schedule.since),
        "next due": _time(schedule.next_due),
        "last due": _time(schedule.last_due),
        "last job": schedule.last_job or "-",
        "fault": schedule.fault or "-",
    }
    given = schedule.job.model_dump(exclude_defaults=True) | {"kind": schedule.job.kind}
    for name, value in rows.items():
        table.add_row(name, escape(value))
    for name, value in given.items():
        table.add_row(f"job: {name}", escape(str(value)))
    Console().print(table)


def _time(moment: datetime | None) -> str:
    return "-" if moment is None else f"{moment:%Y-%m-%d %H:%M} UTC"
