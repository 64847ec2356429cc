"""Jobs: work that is asked for here and done by a worker, which finishes it even when it is killed in between.

This is the side of those who ask: it submits, looks, cancels and retries, and needs the job engine (DBOS) only when it
is used. The worker's side is `worker/jobs.py`.
"""

from __future__ import annotations

import importlib
import logging
import re
import sqlite3
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime, timedelta
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from service.engine.errors import InvalidParameter, JobConflict, JobNotFound, JobsUnavailable
from service.job import ENGINE_STATES, Job, State, read_job
from service.job_records import JobRecords, LogLine
from service.job_specs import KINDS, JobSpec, check_id
from service.model_file import NAME

if TYPE_CHECKING:
    from dbos import DBOSClient

APPLICATION = "shape-concepts"
STEPS_VERSION = "2"  # of the steps a job consists of: another one waits for workers that know it
QUEUE = "jobs"
KEPT = timedelta(days=7)  # as long, what a job that failed or was cancelled has made so far is kept for a retry
MARGIN = timedelta(days=1)  # before that, a retry no longer counts on it
CHUNK = 100  # jobs that are looked at together

SILENCE = logging.NullHandler()


class JobPage(NamedTuple):
    """Jobs, the one submitted last first.

    Attributes:
        jobs: of this page.
        next: what the next page begins before; None if there is none.
    """

    jobs: list[Job]
    next: str | None


class Look(NamedTuple):
    """A job as it stands, and the lines that its log has more."""

    job: Job
    lines: list[LogLine]


class Jobs:
    """The queue of jobs and what became of them, in a database.

    Args:
        url: `sqlite:///FILE` or `postgresql://USER:PASSWORD@HOST/DATABASE`.

    Raises:
        JobsUnavailable: by every method, when the database cannot be used or the job engine is not installed.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        self.records = JobRecords(url)

    def submit(self, spec: JobSpec, job_id: str | None = None) -> Job:
        """Puts a job into the queue.

        Args:
            spec: what it is to do.
            job_id: names the job; submitted again under the same id, it is the same job.

        Raises:
            InvalidParameter: the id is of another form, or another job bears it.
        """
        chosen = str(uuid.uuid4()) if job_id is None else job_id
        check_id(chosen)
        conflict = engine().error.DBOSConflictingWorkflowError  # a job of another kind bears the id: told below
        with reporting(self.url), suppress(conflict):
            prepare(self.url)
            self._client.enqueue(
                {
                    "workflow_name": spec.kind,
                    "queue_name": QUEUE,
                    "workflow_id": chosen,
                    "app_version": STEPS_VERSION,
                    "priority": self.records.enter(chosen),
                },
                spec.model_dump(mode="json"),
            )
        job = self.show(chosen)
        if job.spec != spec:
            raise InvalidParameter(f"There is another job of the id '{chosen}'; what it is to do cannot be changed.")
        return job

    def show(self, job_id: str) -> Job:
        """A job as it stands.

        Raises:
            JobNotFound: there is none of that id.
        """
        found = self._find(workflow_ids=[job_id]) if re.fullmatch(NAME, job_id) else []
        if not found:
            raise JobNotFound(f"There is no job '{job_id[:100]}'.")
        return found[0]

    def page(self, limit: int = 20, before: str | None = None, state: State | None = None) -> JobPage:
        """Jobs, the one submitted last first.

        Args:
            limit: how many at most.
            before: id of a job: those that were submitted before it; None for the newest.
            state: of the jobs; None for all.

        Raises:
            JobNotFound: there is no job that the page could begin before.
        """
        if before is not None:
            self.show(before)
        elif not self._is_there():
            return JobPage([], None)
        with reporting(self.url):
            place = None if before is None else self.records.enter(before)
            names = [name for name, meant in ENGINE_STATES.items() if state in (None, meant)]
            found: list[Job] = []
            while len(found) <= limit and (chunk := self.records.before(place, CHUNK)):
                place = chunk[-1][1]
                jobs = {job.id: job for job in self._find(workflow_ids=[job for job, _ in chunk], status=names)}
                found += [jobs[job] for job, _ in chunk if job in jobs]
        return JobPage(found[:limit], found[limit - 1].id if len(found) > limit else None)

    def look(self, job_id: str, after: int = 0) -> Look:
        """A job as it stands, and the lines of its log after that of a number.

        The job is looked at first: when it is over, no later line is of its work.

        Raises:
            JobNotFound: there is none of that id.
        """
        job = self.show(job_id)
        with reporting(self.url):
            return Look(job, self.records.lines(job_id, after))

    def cancel(self, job_id: str) -> Job:
        """Takes a job from the queue, or stops it; one that is over stays as it is.

        Raises:
            JobNotFound: there is none of that id.
        """
        if not self.show(job_id).over:
            with reporting(self.url):
                self._client.cancel_workflow(job_id)
                self.note(job_id, "cancelled")
        return self.show(job_id)

    def retry(self, job_id: str) -> Job:
        """Lets a job that failed or was cancelled go on, with the stage at which it ended.

        Nothing happens to one that waits or is at work.

        Raises:
            JobNotFound: there is none of that id.
            JobConflict: it is done.
        """
        job = self.show(job_id)
        if job.state == "done":
            raise JobConflict(f"The job '{job_id}' is done; submit another one to do it again.")
        if job.over:
            with reporting(self.url):
                self.records.begin_anew(job_id)
                try:
                    self._client.rewind_workflow(
                        job_id, start_step=self._resuming(job), application_version=STEPS_VERSION, queue_name=QUEUE
                    )
                except engine().error.DBOSException:
                    if self.show(job_id).over:  # else somebody else has just retried it
                        raise
                else:
                    self.note(job_id, "queued again")
        return self.show(job_id)

    def note(self, job_id: str, line: str) -> None:
        """Writes a line to a job's log."""
        self.records.write(job_id, [(time.time(), line)])

    # For workers

    def owners(self) -> dict[str, str]:
        """The jobs at work, and the worker of each."""
        with reporting(self.url):
            running = self._client.list_workflows(
                name=list(KINDS), status="PENDING", load_input=False, load_output=False
            )
            return {status.workflow_id: status.executor_id or "" for status in running}

    def hand_back(self, job_id: str) -> None:
        """Puts a job that its worker is not at any longer into the queue again; finished stages are kept."""
        with reporting(self.url):
            self._client.resume_workflow(job_id, queue_name=QUEUE)

    def close(self) -> None:
        """Lets the database go."""
        if "_client" in self.__dict__:
            self._client.destroy()
        self.records.close()

    @cached_property
    def _client(self) -> DBOSClient:
        dbos = engine()
        return dbos.DBOSClient(
            system_database_url=self.url,
            serializer=dbos.DBOSPortableJSONSerializer(),
            application_name=APPLICATION,
            retry_connection_errors=False,
        )

    def _resuming(self, job: Job) -> int:
        """Number of the step that a retry begins with: the first that has no result which is still there."""
        if job.finished is None or datetime.now(UTC) - job.finished > KEPT - MARGIN:
            return 1
        steps = self._client.list_workflow_steps(job.id)
        good = {step["function_id"] for step in steps if step["error"] is None}
        return next(number for number in range(1, len(good) + 2) if number not in good)

    def _is_there(self) -> bool:
        """Whether there is a database; if not, nothing was ever submitted, and to look must not make one."""
        file = sqlite_file(self.url)
        return file is None or file.exists()

    def _find(self, **which: Any) -> list[Job]:
        if not self._is_there():
            return []
        with reporting(self.url):
            found = self._client.list_workflows(name=list(KINDS), **which)
            progress = self.records.progress([status.workflow_id for status in found])
            begun = self.records.begins([each.workflow_id for each in found if each.dequeued_at is None])
            return [
                read_job(status, progress.get(status.workflow_id), begun.get(status.workflow_id)) for status in found
            ]


def engine() -> Any:
    """The job engine, DBOS.

    Raises:
        JobsUnavailable: it is not installed.
    """
    logging.getLogger("dbos").addHandler(SILENCE)  # its errors are raised, and said by whoever asked
    try:
        return importlib.import_module("dbos")
    except ImportError as error:
        raise JobsUnavailable("Jobs need DBOS: pip install 'shape-concepts[jobs]'.") from error


def prepare(url: str) -> None:
    """Makes the database and its tables where there are none yet, or brings them up to date."""
    file = sqlite_file(url)
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
        with sqlite3.connect(file, timeout=30) as connection:  # lets workers read while another one writes
            connection.execute("PRAGMA journal_mode=WAL")
        connection.close()
    engine().DBOS.migrate(url)
    records = JobRecords(url)
    records.prepare()
    records.close()


def sqlite_file(url: str) -> Path | None:
    """The file of an SQLite database; None for another kind.

    Raises:
        JobsUnavailable: it is no URL of a database.
    """
    scheme, found, rest = url.partition("://")
    if not found or scheme not in ("sqlite", "postgresql", "postgres") or not rest.strip("/"):
        raise JobsUnavailable(
            "The database of jobs is sqlite:///FILE or postgresql://USER:PASSWORD@HOST/DATABASE; "
            f"the given URL begins '{url.partition('@')[0][:12]}'."
        )
    return Path(rest.partition("?")[0].removeprefix("/")) if scheme == "sqlite" else None


@contextmanager
def reporting(url: str) -> Iterator[None]:
    """Says plainly that the database failed; its password stays untold."""
    engine()
    from dbos import error as dbos_error
    from sqlalchemy.exc import DBAPIError, SQLAlchemyError

    try:
        yield
    except (SQLAlchemyError, dbos_error.DBOSException, sqlite3.Error, OSError) as error:
        cause = error.orig if isinstance(error, DBAPIError) and error.orig else error
        reason = (str(cause).strip() or type(cause).__name__).splitlines()[0]
        raise JobsUnavailable(f"The database of jobs, {plain(url)}, cannot be used: {reason}") from error


def plain(url: str) -> str:
    """A database's URL without its password."""
    from sqlalchemy.engine import make_url

    return make_url(url).render_as_string(hide_password=True)
