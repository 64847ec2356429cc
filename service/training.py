"""The use cases on jobs, for the command line and every transport; it knows none of them."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

from service.engine.errors import InvalidParameter, JobNotFound, Overloaded
from service.job import Job, State
from service.job_specs import JobSpec
from service.jobs import JobPage, Jobs, Look
from service.objects import Objects
from service.store import ModelStore

FOLLOWERS = 64  # at a time: each asks the database twice a second
LOOK_EVERY = 0.5  # seconds
REPORTS = {"report.html": "text/html; charset=utf-8", "report.json": "application/json"}


class Report(NamedTuple):
    """A file of an evaluation's report."""

    data: bytes
    media_type: str


class Following:
    """What somebody who follows a job has seen of it.

    Args:
        training: asked about the job.
        job_id: which one.
        after: number of the last line of its log that was seen.
    """

    def __init__(self, training: Training, job_id: str, after: int = 0) -> None:
        self._training, self._job_id, self._after = training, job_id, after
        self._seen: Job | None = None
        self.over = False

    def look(self) -> Look | None:
        """The job as it stands and the further lines of its log; None if all of that was seen before."""
        look = self._training.look(self._job_id, self._after)
        new = bool(look.lines) or look.job != self._seen
        self._seen, self._after = look.job, look.lines[-1].number if look.lines else self._after
        self.over = look.job.over and not look.lines
        return look if new else None


class Training:
    """The use cases on jobs.

    Args:
        jobs: the queue.
        store: of the models; what jobs have written lies beside them.
    """

    def __init__(self, jobs: Jobs, store: ModelStore) -> None:
        self._jobs, self._store = jobs, store
        self._objects = Objects(store.url)
        self._followers = 0
        self._lock = threading.Lock()
        self.ending = threading.Event()
        """Set when the service ends: those who follow a job are let go, and follow it elsewhere."""

    def submit(self, spec: JobSpec, job_id: str | None = None, *, local: bool = False) -> Job:
        """Puts a job into the queue; submitted again under the same id, it is the same job.

        Args:
            spec: what it is to do.
            job_id: names it; None for a random id.
            local: whether it is somebody of this machine who asks.

        Raises:
            InvalidParameter: the id is of another form or another job's, or somebody elsewhere names a folder.
            ModelNotFound: the model to be judged or followed is not there.
        """
        self.check(spec, local=local)
        return self._jobs.submit(spec, job_id)

    def check(self, spec: JobSpec, *, local: bool) -> None:
        """Refuses a job that nobody may ask for, or that cannot be done.

        Raises:
            InvalidParameter: somebody elsewhere names a folder.
            ModelNotFound: the model to be judged, followed or extended is not there.
        """
        if spec.kind == "train" and spec.clouds is not None and not local:
            raise InvalidParameter(
                "Folders of the worker's machine can only be named on its command line; upload a dataset instead."
            )
        for meant in ("parent", "extend", "model"):
            if reference := getattr(spec, meant, None):
                self._store.resolve(reference)

    def job(self, job_id: str) -> Job:
        """A job as it stands."""
        return self._jobs.show(job_id)

    def jobs(self, limit: int = 20, before: str | None = None, state: State | None = None) -> JobPage:
        """Jobs, the one submitted last first; those before a job of that id."""
        return self._jobs.page(limit, before, state)

    def look(self, job_id: str, after: int = 0) -> Look:
        """A job as it stands, and the lines of its log after that of a number."""
        return self._jobs.look(job_id, after)

    def cancel(self, job_id: str) -> Job:
        """Takes a job from the queue, or stops it within seconds; one that is over stays as it is."""
        return self._jobs.cancel(job_id)

    def retry(self, job_id: str) -> Job:
        """Lets a job that failed or was cancelled go on with the stage at which it ended."""
        return self._jobs.retry(job_id)

    def report(self, job_id: str, name: str) -> Report:
        """A file of the report of a job that has evaluated.

        Raises:
            JobNotFound: there is no such job, or it has no such report.
        """
        job = self._jobs.show(job_id)
        if job.result is None or job.result.kind != "evaluate" or name not in REPORTS:
            raise JobNotFound(f"The job '{job_id}' has no {name}: it is {job.state}, and its kind is {job.spec.kind}.")
        try:
            return Report(self._objects.get(f"reports/{job_id}/{name}"), REPORTS[name])
        except FileNotFoundError:
            raise JobNotFound(f"The {name} of the job '{job_id}' is no longer in the store.") from None

    @contextmanager
    def following(self) -> Iterator[None]:
        """Is held by everybody who looks at a job again and again.

        Raises:
            Overloaded: too many do.
        """
        with self._lock:
            if self._followers >= FOLLOWERS:
                raise Overloaded(f"{FOLLOWERS} clients follow jobs already; ask for the state now and then instead.")
            self._followers += 1
        try:
            yield
        finally:
            with self._lock:
                self._followers -= 1

    def follow(self, job_id: str, after: int = 0) -> Iterator[Look]:
        """A job as it stands, whenever something of it is new, until it is over or the service ends."""
        following = Following(self, job_id, after)
        while not following.over:
            if (look := following.look()) is not None:
                yield look
            if not following.over and self.ending.wait(LOOK_EVERY):
                return

    def close(self) -> None:
        """Lets the database go."""
        self.ending.set()
        self._jobs.close()
