"""The worker that takes jobs from the queue: durable workflows, whose finished steps are never done again.

A job is a workflow of DBOS; after each step its outcome is written to the database of the jobs. A worker that is killed
takes its jobs up again when it next starts under the same name, at the step that was broken off.
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
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dbos import DBOS, DBOSConfig, DBOSPortableJSONSerializer
from dbos import error as dbos_error
from joblib import parallel_config

from service.engine.errors import InvalidParameter, JobNotFound, ShapeConceptsError
from service.job_specs import TRAIN, TrainSpec
from service.jobs import (
    APPLICATION,
    QUEUE,
    SILENCE,
    STEPS_VERSION,
    Jobs,
    plain,
    prepare,
    reporting,
    sqlite_file,
)
from service.objects import Objects
from service.settings import Settings, default_store
from service.store import ModelStore
from worker.job_steps import JOBS, JobFiles, gather, learn, publish

RECOVERIES = 50  # a job that was begun as often without coming to an end is given up: it may be what kills workers
TIDY_WARNING = "ignore::UserWarning:joblib.externals.loky.backend.resource_tracker"
LOOK_EVERY = 1.0  # seconds between two looks whether a job was cancelled
SIGNAL_CHECK = 0.5  # seconds; a signal that another thread took wakes no wait without an end

log = logging.getLogger(__name__)


class Stopping(BaseException):
    """The worker ends: the step under way is given up without an outcome, so that it is done again."""


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
        self._url, self._name, self._processes = settings.jobs_url, name, processes
        self._store, self._objects = ModelStore(settings.store), Objects(settings.store)
        self._jobs = Jobs(settings.jobs_url)
        self._stopping = threading.Event()
        self._under_way: set[str] = set()
        self._looked = 0.0

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
            DBOS.register_queue(QUEUE, worker_concurrency=1)

    def stop(self) -> bool:
        """Ends; returns whether a job was broken off, on a thread that still computes."""
        self._stopping.set()
        broken_off = sorted(self._under_way)
        DBOS.destroy()
        self._jobs.close()
        for job in broken_off:
            log.info("job %s is broken off; it goes on when worker %s starts again", job, self._name)
        return bool(broken_off)

    def _register(self) -> None:
        """Tells the job engine the steps and their order."""

        @DBOS.workflow(name=TRAIN, max_recovery_attempts=RECOVERIES)
        def train(spec: dict[str, Any]) -> dict[str, Any]:
            with self._reported():
                DBOS.run_step({"name": "gather"}, self._gather, spec)
                learnt = DBOS.run_step({"name": "learn"}, self._learn, spec)
                version = DBOS.run_step({"name": "publish"}, self._publish, spec)
                DBOS.run_step({"name": "tidy"}, self._files().remove)
                return {
                    "model": spec["name"],
                    "version": version,
                    "clouds": learnt["clouds"],
                    "left_out": learnt["left_out"],
                }

    def _gather(self, spec: dict[str, Any]) -> int:
        with self._working("gathering clouds"):
            self._sweep()
            return gather(TrainSpec.model_validate(spec), self._files(), self._look)

    def _learn(self, spec: dict[str, Any]) -> dict[str, Any]:
        with self._working("learning"):
            left_out = learn(TrainSpec.model_validate(spec), self._files(), self._on_stage)
            for key, why in left_out.items():
                log.warning("job %s: left out %s: %s", DBOS.workflow_id, key, why)
            clouds = len(self._files().index()["keys"])
            return {"clouds": clouds, "left_out": len(left_out)}

    def _publish(self, spec: dict[str, Any]) -> int:
        with self._working("publishing"):
            job = self._jobs.show(str(DBOS.workflow_id))
            once = f"{job.id}-{job.submitted.timestamp() * 1000:.0f}"
            version = publish(TrainSpec.model_validate(spec), self._files(), self._store, job.id, once)
            log.info("job %s: published %s:%d", DBOS.workflow_id, spec["name"], version)
            return version

    def _files(self) -> JobFiles:
        return JobFiles(self._objects, str(DBOS.workflow_id))

    @contextmanager
    def _reported(self) -> Iterator[None]:
        """Says that a job begins, and how it ends."""
        job = str(DBOS.workflow_id)
        self._under_way.add(job)
        log.info("job %s: taken", job)
        try:
            yield
            log.info("job %s: done", job)
        except dbos_error.DBOSWorkflowCancelledError:
            log.info("job %s: cancelled", job)
            raise
        except Exception as error:
            log.error("job %s: failed: %s", job, error)
            raise
        finally:
            if not self._stopping.is_set():
                self._under_way.discard(job)

    @contextmanager
    def _working(self, what: str) -> Iterator[None]:
        """The processes for a step. Whatever goes wrong while the worker ends is no outcome of the step."""
        log.info("job %s: %s", DBOS.workflow_id, what)
        try:
            with parallel_config(backend="loky", n_jobs=self._processes):
                self._look()
                yield
        except Exception:
            if self._stopping.is_set():
                raise Stopping from None
            raise

    def _on_stage(self, stage: str) -> None:
        self._look()
        log.info("job %s: %s", DBOS.workflow_id, stage)

    def _look(self) -> None:
        """Gives the step up when the worker ends or the job was cancelled."""
        if self._stopping.is_set():
            raise Stopping
        if time.monotonic() - self._looked > LOOK_EVERY:
            self._looked = time.monotonic()
            if self._jobs.show(str(DBOS.workflow_id)).state == "cancelled":
                raise dbos_error.DBOSWorkflowCancelledError(f"Job {DBOS.workflow_id} was cancelled.")

    def _sweep(self) -> None:
        """Removes what jobs that failed or were cancelled have left; jobs of another database are not touched."""
        for job in self._objects.folders(JOBS):
            try:
                over = self._jobs.show(job).state not in ("queued", "running")
            except JobNotFound:
                continue
            if over:
                JobFiles(self._objects, job).remove()


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
    """Ends the process at once: a thread that computes cannot be told to end, and what it does is not lost."""
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
