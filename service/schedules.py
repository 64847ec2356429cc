"""Schedules: jobs that are submitted again and again, at the times of a cron expression.

They stand in the database of the jobs. Every worker looks at them each second, and submits the job of the latest time
that is due under an id made of the schedule's name and that time: however many workers do so, it is one job. Times at
which no worker ran, or the job before was still under way, are made good by one job, not by one for each.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from service.cron import Cron
from service.engine.errors import InvalidParameter, ScheduleExists, ScheduleNotFound
from service.job_records import connect
from service.job_specs import JobSpec, read_spec
from service.jobs import Jobs, prepare, reporting, sqlite_file
from service.model_file import NAME

if TYPE_CHECKING:
    from sqlalchemy.engine import Connection, Engine

TABLE = (
    "CREATE TABLE IF NOT EXISTS shape_concepts_schedule (name VARCHAR(40) PRIMARY KEY, cron TEXT, zone TEXT, "
    "spec TEXT, paused INTEGER, since DOUBLE PRECISION, due DOUBLE PRECISION, job VARCHAR(63), fault TEXT)"
)
LONGEST_NAME = 40  # characters; with a time it is the id of a job
MOST = 1000  # schedules: every worker looks at all of them each second


class Schedule(BaseModel):
    """A job that is submitted again and again."""

    model_config = ConfigDict(frozen=True)

    name: str = Field(description="names the schedule")
    cron: str = Field(description="minute, hour, day of month, month, day of week")
    zone: str = Field(description="IANA name of the time zone whose clock it goes by")
    state: Literal["active", "paused"] = Field(description="paused: no job is submitted")
    since: datetime = Field(description="when it was made, or made active again: earlier times count for nothing; UTC")
    next_due: datetime | None = Field(description="when it is next due, UTC; null while paused")
    last_due: datetime | None = Field(description="the last time for which a job was submitted, UTC")
    last_job: str | None = Field(description="id of that job")
    fault: str | None = Field(description="why no job could be submitted for that time; null where one was")
    job: Annotated[JobSpec, Field(discriminator="kind")] = Field(description="what each job is to do")

    def due(self, now: datetime) -> datetime | None:
        """The latest time that is due and for which nothing was submitted; None if there is none."""
        last = Cron(self.cron, self.zone).last(now)
        return last if last > max(self.since, self.last_due or self.since) else None


class Schedules:
    """The schedules in the database of the jobs.

    Args:
        jobs: the queue of that database.

    Raises:
        JobsUnavailable: by every method, when the database cannot be used or the job engine is not installed.
    """

    def __init__(self, jobs: Jobs) -> None:
        self._jobs = jobs
        self._found = False

    def create(self, name: str, cron: Cron, spec: JobSpec) -> Schedule:
        """Makes a schedule; made again with the same times and job, it is the same schedule.

        Raises:
            InvalidParameter: the name is not of that form, or there are too many.
            ScheduleExists: there is another one of that name.
        """
        if not re.fullmatch(NAME, name) or len(name) > LONGEST_NAME:
            raise InvalidParameter(
                f"'{name[:60]}' cannot be the name of a schedule: lower-case letters, digits and hyphens, at most "
                f"{LONGEST_NAME}."
            )
        with reporting(self._jobs.url):
            prepare(self._jobs.url)
            with self._engine.begin() as connection:
                _run(connection, TABLE)
            if len(self.all()) >= MOST:
                raise InvalidParameter(f"There are {MOST} schedules already: delete some.")
            with self._engine.begin() as connection:
                _run(
                    connection,
                    "INSERT INTO shape_concepts_schedule (name, cron, zone, spec, paused, since) "
                    "VALUES (:name, :cron, :zone, :spec, 0, :since) ON CONFLICT (name) DO NOTHING",
                    name=name,
                    cron=cron.expression,
                    zone=cron.zone,
                    spec=spec.model_dump_json(),
                    since=_now().timestamp(),
                )
        made = self.show(name)
        if (made.cron, made.zone, made.job) != (*cron, spec):
            raise ScheduleExists(f"There is another schedule '{name}': delete it first, or take another name.")
        return made

    def all(self) -> list[Schedule]:
        """All schedules, by name."""
        return [self._read(row) for row in self._rows("ORDER BY name")]

    def show(self, name: str) -> Schedule:
        """A schedule as it stands.

        Raises:
            ScheduleNotFound: there is none of that name.
        """
        rows = self._rows("WHERE name = :name", name=name)
        if not rows:
            raise ScheduleNotFound(f"There is no schedule '{name[:60]}'.")
        return self._read(rows[0])

    def pause(self, name: str) -> Schedule:
        """Submits nothing from now on."""
        self.show(name)
        self._write("UPDATE shape_concepts_schedule SET paused = 1 WHERE name = :name", name=name)
        return self.show(name)

    def resume(self, name: str) -> Schedule:
        """Submits again, at times later than now: those of the pause count for nothing."""
        self.show(name)
        self._write(
            "UPDATE shape_concepts_schedule SET paused = 0, since = :now WHERE name = :name AND paused = 1",
            name=name,
            now=_now().timestamp(),
        )
        return self.show(name)

    def delete(self, name: str) -> Schedule:
        """Removes a schedule; jobs that it has submitted stay. Returns what it was.

        Raises:
            ScheduleNotFound: there is none of that name.
        """
        was = self.show(name)
        self._write("DELETE FROM shape_concepts_schedule WHERE name = :name", name=name)
        return was

    # For workers

    def submitted(self, schedule: Schedule, due: datetime, job: str | None, fault: str | None = None) -> None:
        """Writes down that the job of a time was submitted, or why it could not be."""
        self._write(
            "UPDATE shape_concepts_schedule SET due = :due, job = :job, fault = :fault "
            "WHERE name = :name AND since = :since AND (due IS NULL OR due < :due)",
            name=schedule.name,
            since=schedule.since.timestamp(),
            due=due.timestamp(),
            job=job,
            fault=fault,
        )

    def close(self) -> None:
        """Lets the database go."""
        if "_engine" in self.__dict__:
            self._engine.dispose()

    # Inside

    @cached_property
    def _engine(self) -> Engine:
        return connect(self._jobs.url)

    def _rows(self, which: str, **values: Any) -> list[Any]:
        file = sqlite_file(self._jobs.url)
        if file is not None and not file.exists():  # to look must not make a database
            return []
        columns = "name, cron, zone, spec, paused, since, due, job, fault"
        with self._reading() as connection:
            if not self._is_table_there(connection):
                return []
            return list(_run(connection, f"SELECT {columns} FROM shape_concepts_schedule {which}", **values))

    def _is_table_there(self, connection: Connection) -> bool:
        from sqlalchemy import inspect

        self._found = self._found or inspect(connection).has_table("shape_concepts_schedule")
        return self._found

    def _write(self, statement: str, **values: Any) -> None:
        with reporting(self._jobs.url), self._engine.begin() as connection:
            _run(connection, statement, **values)

    @contextmanager
    def _reading(self) -> Iterator[Connection]:
        with reporting(self._jobs.url), self._engine.connect() as connection:
            yield connection

    def _read(self, row: Any) -> Schedule:
        name, cron, zone, spec, paused, since, due, job, fault = row
        return Schedule(
            name=name,
            cron=cron,
            zone=zone,
            state="paused" if paused else "active",
            since=_time(since),
            next_due=None if paused else Cron(cron, zone).next(_now()),
            last_due=None if due is None else _time(due),
            last_job=job,
            fault=fault,
            job=read_spec(json.loads(spec)),
        )


def id_of(schedule: Schedule, due: datetime) -> str:
    """The id of the job for a time, the same at every worker."""
    return f"{schedule.name}-{due.astimezone(UTC):%Y%m%dt%H%M}z"


def _run(connection: Connection, statement: str, **values: Any) -> Any:
    from sqlalchemy import text

    return connection.execute(text(statement), values)


def _now() -> datetime:
    return datetime.now(UTC)


def _time(seconds: float) -> datetime:
    return datetime.fromtimestamp(seconds, UTC)
