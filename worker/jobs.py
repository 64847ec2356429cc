"""The worker that takes jobs from the queue: durable workflows, whose finished steps are never done again.

A job is a workflow of DBOS; after each step its outcome is written to the database of the jobs. A job of a worker that
is killed goes on with the step that was broken off: at this worker when it starts again under the same name, or at
another one that notices (`pulse.py`). Each step is done in a process of its own (`apart.py`).
"""

from __future__ import annotations

import fcntl
import hashlib
import logging
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from dbos import DBOS, DBOSConfig, DBOSPortableJSONSerializer
from dbos import error as dbos_error

from service.engine.errors import (
    ClusterUnavailable,
    InvalidParameter,
    JobNotFound,
    JobsUnavailable,
    JobTimedOut,
    ShapeConceptsError,
    StageDied,
    StoreUnavailable,
)
from service.job import Job
from service.job_specs import JobSpec, read_spec
from service.jobs import APPLICATION, KEPT, QUEUE, SILENCE, STEPS_VERSION, Jobs, plain, prepare, reporting, sqlite_file
from service.objects import Objects
from service.settings import Settings, default_store
from service.store import ModelStore
from worker import job_steps
from worker.apart import preload, run_apart
from worker.job_files import JOBS, JobFiles
from worker.job_report import JobReport
from worker.job_steps import Place
from worker.pulse import Pulse
from worker.scheduling import Scheduling

RECOVERIES = 50  # a job that was begun as often without coming to an end is given up: it may be what kills workers
TIDY_WARNING = "ignore::UserWarning:joblib.externals.loky.backend.resource_tracker"
LONGEST_PAUSE = 60.0  # seconds between two tries of a step
SIGNAL_CHECK = 0.5  # seconds; a signal that another thread took wakes no wait without an end
POLLED_EVERY = 0.5  # seconds between two looks into the queue
PASSING = (
    ClusterUnavailable,
    StoreUnavailable,
    JobsUnavailable,
    StageDied,
)  # what may be over when a step is tried again

log = logging.getLogger(__name__)


class Stopping(BaseException):
    """The worker ends, or the job is another's by now: the step is given up without an outcome."""


FORESEEN = (
    ShapeConceptsError,
    Stopping,
    dbos_error.DBOSWorkflowCancelledError,
    dbos_error.DBOSAwaitedWorkflowCancelledError,
)


class Worker:
    """Takes jobs and does them, one at a time.

    Args:
        settings: where jobs come from and models go to.
        name: of the worker; what a worker of this name has broken off, it takes up again.
        processes: that a job may use.
    """

    def __init__(self, settings: Settings, name: str, processes: int) -> None:
        self._url, self._name = settings.jobs_url, name
        self._processes, self._cluster = processes, settings.cluster
        self._store, self._objects = ModelStore(settings.store), Objects(settings.store)
        self._jobs = Jobs(settings.jobs_url)
        self._pulse = Pulse(self._jobs, name, settings.worker_lease)
        self._scheduling = Scheduling(self._jobs)
        self._stopping = threading.Event()
        self._under_way: set[str] = set()

    def start(self) -> None:
        """Begins to take jobs, the broken off ones of its own first.

        Raises:
            JobsUnavailable: the database cannot be used.
        """
        config = DBOSConfig(
            name=APPLICATION,
            system_database_url=self._url,
            executor_id=self._name,
            application_version=STEPS_VERSION,
            serializer=DBOSPortableJSONSerializer(),
            log_level="WARNING",
        )
        with reporting(self._url):
            prepare(self._url)
            self._sweep()
            DBOS(config=config)
            self._register()
            DBOS.listen_queues([QUEUE])
            DBOS.launch()
            DBOS.register_queue(QUEUE, worker_concurrency=1, polling_interval_sec=POLLED_EVERY)
        self._pulse.start()
        self._scheduling.start()

    def stop(self) -> bool:
        """Ends; a job under way goes back into the queue. Returns whether there was one."""
        self._stopping.set()
        self._scheduling.stop()
        broken_off = sorted(self._under_way)
        DBOS.destroy(workflow_completion_timeout_sec=5)
        for job in broken_off:
            with suppress(ShapeConceptsError):  # it is taken over when others notice
                if self._jobs.owners().get(job) == self._name:
                    self._jobs.note(job, f"broken off: worker {self._name} ends")
                    self._jobs.hand_back(job)
            log.info("job %s: broken off, and back in the queue", job)
        self._pulse.stop()
        self._jobs.close()
        return bool(broken_off)

    def _register(self) -> None:
        """Tells the job engine the steps of each kind of job and their order."""

        @DBOS.workflow(name="train", max_recovery_attempts=RECOVERIES)
        def train(spec: dict[str, Any]) -> dict[str, Any]:
            with self._reported(spec) as (step, once):
                step("gather", job_steps.gather)
                learnt = step("learn", job_steps.learn)
                metrics = step("judge", job_steps.judge) if spec.get("labelled") else None
                published = step("publish", job_steps.publish, metrics, once)
                promoted = step("promote", job_steps.promote, published["version"], published["parent"])
                DBOS.run_step({"name": "tidy"}, self._tidy)
                made = {"kind": "train", "model": spec["name"], "metrics": metrics}
                return {**made, **published, **promoted, **learnt}

        @DBOS.workflow(name="evaluate", max_recovery_attempts=RECOVERIES)
        def evaluate(spec: dict[str, Any]) -> dict[str, Any]:
            with self._reported(spec) as (step, _):
                model = step("resolve", job_steps.resolve)
                evaluated: dict[str, Any] = step("evaluate", job_steps.evaluate_model, model)
                return evaluated

        @DBOS.workflow(name="simulate", max_recovery_attempts=RECOVERIES)
        def simulate(spec: dict[str, Any]) -> dict[str, Any]:
            with self._reported(spec) as (step, _):
                simulated: dict[str, Any] = step("simulate", job_steps.simulate_into)
                return simulated

    def _tidy(self) -> None:
        """Forgets what the job has kept; what cannot be removed now is swept when a worker starts."""
        try:
            JobFiles(self._objects, str(DBOS.workflow_id)).remove()
        except StoreUnavailable as error:
            log.warning("job %s: its files stay for now: %s", DBOS.workflow_id, error)

    @contextmanager
    def _reported(self, given: dict[str, Any]) -> Iterator[tuple[Callable[..., Any], str]]:
        """Says that a job begins, and how it ends.

        Yields:
            What does a step of it, and what no other job has.
        """
        spec, (job, begun) = read_spec(given), self._begin(str(DBOS.workflow_id))
        report = JobReport(self._jobs.records, job.id, job_steps.stages_of(spec), begun)
        self._under_way.add(job.id)
        report.log(f"taken by worker {self._name}")
        self._pulse.take_up(job.id, report)
        deadline = None if spec.timeout is None else begun + spec.timeout

        def step(name: str, work: Callable[..., Any], *more: Any) -> Any:
            return DBOS.run_step({"name": name}, self._do, work, spec, more, report, deadline)

        try:
            yield step, f"{job.id}-{job.submitted.timestamp() * 1000:.0f}"
            report.log("done")
        except dbos_error.DBOSWorkflowCancelledError:
            log.info("job %s: cancelled", job.id)
            raise
        except Exception as error:
            report.log(f"failed: {error}", logging.ERROR)
            raise
        finally:
            self._pulse.lay_down()
            with suppress(Exception):
                report.write()
            if not self._stopping.is_set():
                self._under_way.discard(job.id)

    def _begin(self, job_id: str) -> tuple[Job, float]:
        """The job, and when it was first begun. A database that is out of reach is waited for."""
        while True:
            try:
                job = self._jobs.show(job_id)
                with reporting(self._url):
                    return job, self._jobs.records.begun(job_id)
            except JobsUnavailable:
                if self._stopping.wait(1):
                    raise Stopping from None

    def _do(
        self,
        work: Callable[..., Any],
        spec: JobSpec,
        more: tuple[Any, ...],
        report: JobReport,
        deadline: float | None,
    ) -> Any:
        """Does a step, again and again as long as what it lacks may come back."""
        place = Place(self._store.url, str(DBOS.workflow_id), self._processes, self._cluster)

        def look() -> None:
            self._look(spec, deadline)

        for attempt in range(1, spec.attempts + 1):
            try:
                result = run_apart(work, (spec, place, *more), report.tell, look)
                with suppress(Exception):
                    report.write()
                return result
            except PASSING as error:
                if attempt == spec.attempts:
                    raise
                pause = min(2.0**attempt, LONGEST_PAUSE)
                report.log(f"tried {attempt} of {spec.attempts} times; again in {pause:g} s: {error}", logging.WARNING)
                until = time.monotonic() + pause
                while time.monotonic() < until:
                    look()
                    self._stopping.wait(0.2)
        raise AssertionError("the last attempt returns or raises")

    def _look(self, spec: JobSpec, deadline: float | None) -> None:
        """Gives the step up when the worker ends, or the job is cancelled, another's, or took too long."""
        if self._stopping.is_set() or self._pulse.verdict == "lost":
            raise Stopping
        if self._pulse.verdict == "cancelled":
            raise dbos_error.DBOSWorkflowCancelledError(f"Job {DBOS.workflow_id} was cancelled.")
        if deadline is not None and time.time() > deadline:
            raise JobTimedOut(
                f"It was at work for longer than its timeout of {spec.timeout:g} s. A retry goes on where it was, and "
                "has as long again; or submit it with a longer timeout."
            )

    def _sweep(self) -> None:
        """Removes what jobs have left that cannot be retried any more; jobs of another database are not touched."""
        for job_id in self._objects.folders(JOBS):
            try:
                job = self._jobs.show(job_id)
            except JobNotFound:
                continue
            if job.state == "done" or (job.over and job.finished and datetime.now(UTC) - job.finished > KEPT):
                JobFiles(self._objects, job_id).remove()


def run(settings: Settings, name: str, processes: int) -> None:
    """Takes jobs until SIGTERM or SIGINT. The job under way is broken off then; its finished steps are kept.

    Args:
        settings: where jobs come from and models go to.
        name: of the worker, the same whenever it starts; no two have the same.
        processes: that a job may use.

    Raises:
        InvalidParameter: a worker of that name runs on this machine already.
        JobsUnavailable: the database of the jobs cannot be used.
    """
    logging.basicConfig(level=settings.log_level.upper(), format="%(asctime)s %(levelname)s %(message)s")
    _quiet_engine()
    # joblib's own watcher clears away what a broken off job leaves, and need not warn of having done so.
    os.environ["PYTHONWARNINGS"] = ",".join(filter(None, [os.environ.get("PYTHONWARNINGS"), TIDY_WARNING]))
    preload()
    told_to_end = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: told_to_end.set())
    with _alone(name, settings.jobs_url):
        worker = Worker(settings, name, processes)
        worker.start()
        log.info("worker %s takes jobs from %s and publishes to %s", name, plain(settings.jobs_url), settings.store)
        while not told_to_end.wait(SIGNAL_CHECK):
            pass
        log.info("ending")
        if worker.stop():
            _leave()
    log.info("ended")


def _quiet_engine() -> None:
    """Lets the job engine log as we do, and leave to us what was foreseen."""
    logger = logging.getLogger("dbos")
    logger.setLevel(logging.WARNING)
    logger.addHandler(SILENCE)  # so that it adds no handler of its own
    logger.addFilter(lambda record: not (record.exc_info and isinstance(record.exc_info[1], FORESEEN)))


def _leave() -> None:
    """Ends the process at once: a thread may wait for the database still."""
    for child in multiprocessing.active_children():
        if child.pid is not None:
            os.kill(child.pid, signal.SIGKILL)
    log.info("ended")
    logging.shutdown()
    sys.stdout.flush()
    os._exit(0)


@contextmanager
def _alone(name: str, url: str) -> Iterator[None]:
    """Keeps a second worker of the name away: each would take up what the other is doing."""
    file = sqlite_file(url)
    folder = file.parent if file else Path(default_store())
    folder.mkdir(parents=True, exist_ok=True)
    digest = hashlib.sha256(f"{url} {name}".encode()).hexdigest()[:16]
    with open(folder / f"worker-{digest}.lock", "w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InvalidParameter(
                f"A worker of the name '{name}' takes jobs from there already: give this one another with --worker."
            ) from None
        yield
