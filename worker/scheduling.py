"""The worker's eye on the schedules: submits the jobs whose time has come."""

from __future__ import annotations

import logging
import threading
from datetime import UTC, datetime

from service.engine.errors import JobNotFound, JobsUnavailable, ShapeConceptsError
from service.jobs import Jobs
from service.schedules import Schedule, Schedules, id_of

LOOK_EVERY = 1.0  # seconds
log = logging.getLogger(__name__)


class Scheduling:
    """A thread that submits jobs as schedules say; several workers may do so at a time, to the effect of one.

    Args:
        jobs: the queue.
    """

    def __init__(self, jobs: Jobs) -> None:
        self._jobs, self._schedules = jobs, Schedules(jobs)
        self._stopping = threading.Event()
        self._complained = False
        self._thread = threading.Thread(target=self._run, name="schedules", daemon=True)

    def start(self) -> None:
        """Begins."""
        self._thread.start()

    def stop(self) -> None:
        """Ends."""
        self._stopping.set()
        self._thread.join(10)
        self._schedules.close()

    def look(self, now: datetime) -> list[str]:
        """Submits what is due; returns the ids of these jobs.

        Raises:
            JobsUnavailable: the database is out of reach; what is due is submitted at the next look.
        """
        submitted = (self._submit(schedule, now) for schedule in self._schedules.all() if schedule.state == "active")
        return [job for job in submitted if job is not None]

    def _run(self) -> None:
        while not self._stopping.is_set():
            try:
                self.look(datetime.now(UTC))
                self._complained = False
            except Exception as error:  # whatever the database does, this thread goes on
                if not self._complained:
                    log.warning("schedules cannot be looked at: %s", (str(error).splitlines() or [repr(error)])[0])
                self._complained = True
            self._stopping.wait(LOOK_EVERY)

    def _submit(self, schedule: Schedule, now: datetime) -> str | None:
        """The id of the job that was submitted; None where none is due, or the one before is not over."""
        due = schedule.due(now)
        if due is None or self._under_way(schedule):
            return None
        try:
            job = self._jobs.submit(schedule.job, id_of(schedule, due)).id
        except JobsUnavailable:
            raise
        except ShapeConceptsError as error:
            log.error("schedule %s: no job for %s: %s", schedule.name, due, error)
            self._schedules.submitted(schedule, due, None, str(error))
            return None
        self._schedules.submitted(schedule, due, job)
        log.info("schedule %s: job %s is submitted", schedule.name, job)
        return job

    def _under_way(self, schedule: Schedule) -> bool:
        if schedule.last_job is None:
            return False
        try:
            return not self._jobs.show(schedule.last_job).over
        except JobNotFound:
            return False
