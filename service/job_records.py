"""What is known of jobs beside the job engine's own tables: their order, logs, progress, and workers' signs of life.

All of it stands in the database of the jobs, so that every replica of the service tells the same.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

from pydantic import BaseModel, Field

if TYPE_CHECKING:
    from sqlalchemy.engine import Connection, Engine

TABLES = (
    "CREATE TABLE IF NOT EXISTS shape_concepts_job_log ("
    "job VARCHAR(63), number INTEGER, at DOUBLE PRECISION, line TEXT, PRIMARY KEY (job, number))",
    "CREATE TABLE IF NOT EXISTS shape_concepts_job ("
    "job VARCHAR(63) PRIMARY KEY, place INTEGER UNIQUE, begun DOUBLE PRECISION, progress TEXT)",
    "CREATE TABLE IF NOT EXISTS shape_concepts_worker (name VARCHAR(200) PRIMARY KEY, beat TEXT)",
)
LONGEST_LINE = 1000  # characters
TRIES = 10  # to take the next number of a log that several write to


class Progress(BaseModel):
    """How far a job is."""

    stage: str = Field(description="what is being done")
    done: int = Field(0, ge=0, description="of the stage's pieces, how many are done")
    total: int | None = Field(None, ge=0, description="how many pieces the stage has; null where that is not known")
    stages_done: int = Field(ge=0, description="how many stages are done")
    stages: int = Field(ge=1, description="how many stages there are")
    left_s: float | None = Field(None, ge=0, description="estimate of the time until the job is done, seconds")


class LogLine(NamedTuple):
    """A line of a job's log.

    Attributes:
        number: counts up from 1.
        at: time, seconds since 1970, UTC.
        line: the text.
    """

    number: int
    at: float
    line: str


def connect(url: str) -> Engine:
    """The database of the jobs, for tables of our own beside those of the job engine.

    Args:
        url: as of `Jobs`.
    """
    import sqlalchemy

    address = sqlalchemy.make_url(url)
    if address.drivername.startswith("postgres"):
        return sqlalchemy.create_engine(
            address.set(drivername="postgresql+psycopg"),
            pool_pre_ping=True,
            pool_size=2,
            connect_args={"connect_timeout": 10},
        )
    return sqlalchemy.create_engine(address, connect_args={"timeout": 30})


class JobRecords:
    """The records in the database of the jobs.

    Args:
        url: as of `Jobs`.
    """

    def __init__(self, url: str) -> None:
        self._url = url

    def prepare(self) -> None:
        """Makes the tables where there are none yet."""
        from sqlalchemy.exc import DBAPIError

        for last in (False, True):
            try:
                with self._writing() as connection:
                    for table in TABLES:
                        self._run(connection, table)
                return
            except DBAPIError:  # Postgres: another process has just made them
                if last:
                    raise

    def close(self) -> None:
        """Lets the database go."""
        if "_engine" in self.__dict__:
            self._engine.dispose()

    # Order

    def enter(self, job: str) -> int:
        """The place of a job in the order of submission: the next one, if it has none yet."""
        self._number(
            "INSERT INTO shape_concepts_job (job, place) "
            "SELECT :job, coalesce(max(place), 0) + 1 FROM shape_concepts_job WHERE true "
            "ON CONFLICT (job) DO NOTHING",
            [{"job": job}],
        )
        return int(self._all("SELECT place FROM shape_concepts_job WHERE job = :job", job=job)[0][0])

    def before(self, place: int | None, limit: int) -> list[tuple[str, int]]:
        """Jobs and their places, the last one first: those before a place, or all."""
        return [
            (str(job), int(at))
            for job, at in self._all(
                "SELECT job, place FROM shape_concepts_job WHERE place < :place ORDER BY place DESC LIMIT :limit",
                place=2**31 - 1 if place is None else place,
                limit=limit,
            )
        ]

    # Logs

    def write(self, job: str, lines: Sequence[tuple[float, str]]) -> None:
        """Appends lines to the log of a job, each with its time."""
        self._number(
            "INSERT INTO shape_concepts_job_log (job, number, at, line) "
            "SELECT CAST(:job AS VARCHAR(63)), coalesce(max(number), 0) + 1, CAST(:at AS DOUBLE PRECISION), :line "
            "FROM shape_concepts_job_log WHERE job = CAST(:job AS VARCHAR(63))",
            [{"job": job, "at": at, "line": line[:LONGEST_LINE]} for at, line in lines],
        )

    def lines(self, job: str, after: int = 0, limit: int = 1000) -> list[LogLine]:
        """Lines of a job's log after that of a number, oldest first."""
        found = self._all(
            "SELECT number, at, line FROM shape_concepts_job_log WHERE job = :job AND number > :after "
            "ORDER BY number LIMIT :limit",
            job=job,
            after=after,
            limit=limit,
        )
        return [LogLine(*row) for row in found]

    # Progress

    def begun(self, job: str) -> float:
        """When a job was first begun, seconds since 1970: now, if it was not before."""
        with self._writing() as connection:
            self._run(
                connection,
                "INSERT INTO shape_concepts_job (job, begun) VALUES (:job, :now) "
                "ON CONFLICT (job) DO UPDATE SET begun = coalesce(shape_concepts_job.begun, excluded.begun)",
                job=job,
                now=time.time(),
            )
            row = self._run(connection, "SELECT begun FROM shape_concepts_job WHERE job = :job", job=job).one()
            return float(row[0])

    def begin_anew(self, job: str) -> None:
        """Forgets when a job was begun, and how far it was."""
        with self._writing() as connection:
            self._run(
                connection, "UPDATE shape_concepts_job SET begun = NULL, progress = NULL WHERE job = :job", job=job
            )

    def tell(self, job: str, progress: Progress) -> None:
        """Says how far a job is."""
        with self._writing() as connection:
            self._run(
                connection,
                "INSERT INTO shape_concepts_job (job, progress) VALUES (:job, :progress) "
                "ON CONFLICT (job) DO UPDATE SET progress = excluded.progress",
                job=job,
                progress=progress.model_dump_json(),
            )

    def begins(self, jobs: Sequence[str]) -> dict[str, float]:
        """When jobs were first begun, seconds since 1970; those that never were are left out."""
        from sqlalchemy import bindparam, text

        if not jobs:
            return {}
        asked = text("SELECT job, begun FROM shape_concepts_job WHERE begun IS NOT NULL AND job IN :jobs")
        with self._engine.connect() as connection:
            rows = connection.execute(asked.bindparams(bindparam("jobs", expanding=True)), {"jobs": list(jobs)})
            return {str(job): float(begun) for job, begun in rows}

    def progress(self, jobs: Sequence[str]) -> dict[str, Progress]:
        """How far jobs are; those that never began are left out."""
        from sqlalchemy import bindparam, text

        asked = text("SELECT job, progress FROM shape_concepts_job WHERE progress IS NOT NULL AND job IN :jobs")
        with self._engine.connect() as connection:
            rows = connection.execute(asked.bindparams(bindparam("jobs", expanding=True)), {"jobs": list(jobs)})
            return {str(job): Progress.model_validate_json(told) for job, told in rows}

    # Signs of life

    def beat(self, worker: str, beat: str) -> None:
        """A worker's sign of life: any text that is not that of the time before."""
        with self._writing() as connection:
            self._run(
                connection,
                "INSERT INTO shape_concepts_worker (name, beat) VALUES (:worker, :beat) "
                "ON CONFLICT (name) DO UPDATE SET beat = excluded.beat",
                worker=worker,
                beat=beat,
            )

    def beats(self) -> dict[str, str]:
        """The last sign of life of every worker that has not ended."""
        return {str(name): str(beat) for name, beat in self._all("SELECT name, beat FROM shape_concepts_worker")}

    def ended(self, worker: str) -> None:
        """Forgets a worker."""
        with self._writing() as connection:
            self._run(connection, "DELETE FROM shape_concepts_worker WHERE name = :worker", worker=worker)

    # Inside

    @cached_property
    def _engine(self) -> Engine:
        return connect(self._url)

    def _number(self, statement: str, each: list[dict[str, Any]]) -> None:
        """Runs a statement that takes the next number, for each of several values, all or none."""
        from sqlalchemy.exc import IntegrityError

        for last in [False] * (TRIES - 1) + [True]:
            try:
                with self._writing() as connection:
                    for values in each:
                        self._run(connection, statement, **values)
                return
            except IntegrityError:  # another process has taken it
                if last:
                    raise
                time.sleep(0.02)

    @contextmanager
    def _writing(self) -> Iterator[Connection]:
        with self._engine.begin() as connection:
            yield connection

    def _all(self, statement: str, **values: Any) -> list[Any]:
        with self._engine.connect() as connection:
            return list(self._run(connection, statement, **values))

    def _run(self, connection: Connection, statement: str, **values: Any) -> Any:
        from sqlalchemy import text

        return connection.execute(text(statement), values)
