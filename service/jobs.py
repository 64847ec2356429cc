"""Jobs: work that is asked for here and done by a worker, which finishes it even when it is killed in between.

This is the side of those who ask: it submits, looks and cancels, and needs the job engine (DBOS) only when it is used.
The worker's side is `worker/jobs.py`.
"""

from __future__ import annotations

import importlib
import logging
import sqlite3
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from pydantic import BaseModel, Field

from service.engine import errors
from service.engine.errors import InvalidParameter, JobNotFound, JobsUnavailable, ShapeConceptsError
from service.job_specs import KINDS, JobSpec, check_id, read_spec

if TYPE_CHECKING:
    from dbos import DBOSClient, WorkflowStatus

APPLICATION = "shape-concepts"
STEPS_VERSION = "1"  # of the steps a job consists of: another one waits for workers that know it
QUEUE = "jobs"

SILENCE = logging.NullHandler()

State = Literal["queued", "running", "done", "failed", "cancelled"]
STATES: dict[str, State] = {
    "ENQUEUED": "queued",
    "DELAYED": "queued",
    "PENDING": "running",
    "SUCCESS": "done",
    "ERROR": "failed",
    "MAX_RECOVERY_ATTEMPTS_EXCEEDED": "failed",
    "CANCELLED": "cancelled",
}


class JobResult(BaseModel):
    """What a training job has made."""

    model: str = Field(description="name of the model")
    version: int = Field(ge=1, description="the version published")
    clouds: int = Field(description="clouds that it was learnt from")
    left_out: int = Field(description="clouds that could not be learnt from")


class JobError(BaseModel):
    """Why a job failed."""

    type: str = Field(description="stable, kebab-case name of the error")
    detail: str = Field(description="what was wrong, and what to try")


class Job(BaseModel):
    """A job, as it stands."""

    id: str = Field(description="names the job")
    state: State = Field(description="queued, running, done, failed or cancelled")
    spec: JobSpec = Field(description="what it is to do")
    submitted: datetime = Field(description="UTC")
    started: datetime | None = Field(description="when a worker last took it, UTC")
    finished: datetime | None = Field(description="UTC")
    worker: str | None = Field(description="the worker that last took it")
    result: JobResult | None = Field(description="what it has made")
    error: JobError | None = Field(description="why it failed")


class Jobs:
    """The queue of jobs and what became of them, in a database.

    Args:
        url: `sqlite:///FILE` or `postgresql://USER:PASSWORD@HOST/DATABASE`.

    Raises:
        JobsUnavailable: by every method, when the database cannot be used or the job engine is not installed.
    """

    def __init__(self, url: str) -> None:
        self.url = url

    def submit(self, spec: JobSpec, job_id: str | None = None) -> Job:
        """Puts a job into the queue.

        Args:
            spec: what it is to do.
            job_id: names the job; submitted again under the same id, it is the same job.

        Raises:
            InvalidParameter: the id is of another form, or another job bears it.
        """
        chosen = job_id or str(uuid.uuid4())
        check_id(chosen)
        with reporting(self.url):
            prepare(self.url)
            self._client.enqueue(
                {
                    "workflow_name": spec.kind,
                    "queue_name": QUEUE,
                    "workflow_id": chosen,
                    "app_version": STEPS_VERSION,
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
        found = self._find(workflow_ids=[job_id])
        if not found:
            raise JobNotFound(f"There is no job '{job_id}'.")
        return found[0]

    def recent(self, limit: int | None = None) -> list[Job]:
        """Jobs, the one submitted last first."""
        return self._find(limit=limit, sort_desc=True)

    def cancel(self, job_id: str) -> Job:
        """Takes a job from the queue, or stops it; one that is over stays as it is.

        Raises:
            JobNotFound: there is none of that id.
        """
        job = self.show(job_id)
        if job.state in ("queued", "running"):
            with reporting(self.url):
                self._client.cancel_workflow(job_id)
        return self.show(job_id)

    def close(self) -> None:
        """Lets the database go."""
        if "_client" in self.__dict__:
            self._client.destroy()

    @cached_property
    def _client(self) -> DBOSClient:
        dbos = engine()
        return dbos.DBOSClient(
            system_database_url=self.url,
            serializer=dbos.DBOSPortableJSONSerializer(),
            application_name=APPLICATION,
            retry_connection_errors=False,
        )

    def _find(self, **which: Any) -> list[Job]:
        file = sqlite_file(self.url)
        if file is not None and not file.exists():  # nothing was ever submitted; to look must not make a database
            return []
        with reporting(self.url):
            return [_job(status) for status in self._client.list_workflows(name=list(KINDS), **which)]


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


def _job(status: WorkflowStatus) -> Job:
    state = STATES[status.status]
    inputs: Any = status.input
    return Job(
        id=status.workflow_id,
        state=state,
        spec=read_spec(inputs["args"][0]),
        submitted=_time(status.created_at) or datetime.now(UTC),
        started=_time(status.dequeued_at),
        finished=_time(status.completed_at),
        worker=status.executor_id if state != "queued" else None,
        result=JobResult.model_validate(status.output) if state == "done" else None,
        error=_error(status) if state == "failed" else None,
    )


def _error(status: WorkflowStatus) -> JobError:
    if status.status != "ERROR":
        return JobError(type="internal", detail="It was begun too often without coming to an end.")
    name, detail = getattr(status.error, "name", type(status.error).__name__), str(status.error)
    known = getattr(errors, name, None)
    if isinstance(known, type) and issubclass(known, ShapeConceptsError):
        return JobError(type=known.type_name(), detail=detail)
    return JobError(type="internal", detail=f"Something unexpected went wrong: {name}. The worker's log says more.")


def _time(milliseconds: int | None) -> datetime | None:
    return None if milliseconds is None else datetime.fromtimestamp(milliseconds / 1000, UTC)
