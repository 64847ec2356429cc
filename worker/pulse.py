"""A worker's sign of life, and its eye on other workers and on the job that it is at.

Whether another worker lives is told by its sign of life changing, by this worker's own clock: clocks of several
machines need not agree. A job of one that gives none is handed back to the queue by a single statement that only holds
while the job is still that worker's: of several who notice, one does it, and once.
"""

from __future__ import annotations

import logging
import threading
import time
import uuid
from typing import Literal

from dbos import DBOS

from service.jobs import Jobs
from worker.job_report import JobReport

BEAT_EVERY = 1.0  # seconds
log = logging.getLogger(__name__)

Verdict = Literal["wanted", "cancelled", "lost"]


class Pulse:
    """A thread that gives signs of life, and looks at those of others.

    Args:
        jobs: the queue.
        name: of this worker.
        lease: after this time without a sign of life a worker is taken for dead, seconds.
    """

    def __init__(self, jobs: Jobs, name: str, lease: float) -> None:
        self._jobs, self._name, self._lease = jobs, name, lease
        self._life = uuid.uuid4().hex
        self._beats = 0
        self._seen: dict[str, tuple[str, float]] = {}
        self._job: tuple[str, JobReport] | None = None
        self._verdict: Verdict = "wanted"
        self._stopping = threading.Event()
        self._complained = False
        self._thread = threading.Thread(target=self._run, name="pulse", daemon=True)

    def start(self) -> None:
        """Begins."""
        self._thread.start()

    def stop(self) -> None:
        """Ends; others know at once that this worker is gone."""
        self._stopping.set()
        self._thread.join(10)
        try:
            self._jobs.records.ended(self._name)
        except Exception as error:  # they notice after a while
            log.warning("the database cannot be told of the end: %s", _first_line(error))

    def take_up(self, job: str, report: JobReport) -> None:
        """Keeps an eye on a job from now on, and writes its report."""
        self._verdict, self._job = "wanted", (job, report)

    def lay_down(self) -> None:
        """Keeps no eye on it any longer."""
        self._job = None

    @property
    def verdict(self) -> Verdict:
        """Whether the job is still wanted, and this worker's."""
        return self._verdict

    def _run(self) -> None:
        while not self._stopping.is_set():
            try:
                self._beat()
                self._complained = False
            except Exception as error:  # whatever the database does, this thread goes on
                if not self._complained:
                    log.warning("the database of the jobs is out of reach: %s", _first_line(error))
                self._complained = True
            self._stopping.wait(BEAT_EVERY)

    def _beat(self) -> None:
        self._beats += 1
        self._jobs.records.beat(self._name, f"{self._life} {self._beats}")
        current = self._job  # before the owners: what is under way by then was claimed before
        owners = self._jobs.owners()
        if current is not None and owners.get(current[0]) != self._name and self._job is current:
            self._verdict = "cancelled" if self._jobs.show(current[0]).state == "cancelled" else "lost"
        self._look_after(owners)
        if current is not None:
            current[1].write()

    def _look_after(self, owners: dict[str, str]) -> None:
        """Hands jobs back that nobody is at.

        Args:
            owners: the jobs at work, and whose they are.
        """
        beats = self._jobs.records.beats()
        mine = self._job[0] if self._job else None
        watched = {f"worker {name}": beats.get(name, "") for name in {*owners.values(), *beats} - {self._name}}
        watched |= {f"job {job}": "" for job, owner in owners.items() if owner == self._name and job != mine}
        self._seen = {who: seen for who, seen in self._seen.items() if who in watched}
        for who, beat in watched.items():
            seen = self._seen.setdefault(who, (beat, time.monotonic()))
            if seen[0] != beat:
                self._seen[who] = (beat, time.monotonic())
            elif time.monotonic() - seen[1] > self._lease:
                kind, _, which = who.partition(" ")
                if kind == "worker":
                    self._take_over(which, [job for job, owner in owners.items() if owner == which])
                else:  # what was to be written of it could not be: the disk was full, say
                    self._jobs.hand_back(which)
                del self._seen[who]

    def _take_over(self, worker: str, jobs: list[str]) -> None:
        for job in jobs:
            line = f"worker {worker} has given no sign of life for {self._lease:g} s: back in the queue"
            log.info("job %s: %s", job, line)
            self._jobs.note(job, line)
        if jobs:
            DBOS._recover_pending_workflows([worker])
        self._jobs.records.ended(worker)


def _first_line(error: Exception) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[0]
