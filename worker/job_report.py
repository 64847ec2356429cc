"""What a job under way tells: lines of its log and how far it is, written to the database when that can be reached."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Mapping

from service.job_records import JobRecords, Progress
from worker.apart import Count

LEAST = 0.02  # share of the work after which the time left can be told
log = logging.getLogger(__name__)


class JobReport:
    """What one job tells; several threads may use it.

    Args:
        records: where it is written to.
        job: its id.
        stages: in order, with their shares of the time.
        begun: when it was begun, seconds since 1970.
    """

    def __init__(self, records: JobRecords, job: str, stages: Mapping[str, float], begun: float) -> None:
        self._records, self._job, self._shares, self._begun = records, job, dict(stages), begun
        self._lines: list[tuple[float, str]] = []
        self._progress: Progress | None = None
        self._stage = ""
        self._lock = threading.Lock()  # of what is not written yet
        self._writing = threading.Lock()

    def tell(self, said: Count | str) -> None:
        """Takes a line for the log, or how far a stage is."""
        if isinstance(said, str):
            self.log(said)
            return
        if said.stage != self._stage:
            self._stage = said.stage
            self.log(said.stage)
        with self._lock:
            self._progress = self._progress_at(said)

    def log(self, line: str, level: int = logging.INFO) -> None:
        """Takes a line for the log."""
        log.log(level, "job %s: %s", self._job, line)
        with self._lock:
            self._lines.append((time.time(), line))

    def write(self) -> None:
        """Writes what was taken and is not written yet.

        Raises:
            SQLAlchemyError: the database is out of reach; it is written next time.
        """
        with self._writing:
            with self._lock:
                lines, self._lines = self._lines, []
                progress, self._progress = self._progress, None
            try:
                if lines:
                    self._records.write(self._job, lines)
                    lines = []
                if progress is not None:
                    self._records.tell(self._job, progress)
            except BaseException:
                with self._lock:
                    self._lines = lines + self._lines
                    self._progress = self._progress or progress
                raise

    def _progress_at(self, said: Count) -> Progress:
        stages = list(self._shares)
        place = stages.index(said.stage) if said.stage in stages else 0
        done = sum(self._shares[stage] for stage in stages[:place])
        done += self._shares.get(said.stage, 0.0) * (said.done / said.total if said.total else 0.0)
        left = (time.time() - self._begun) * (1 - done) / done if done > LEAST else None
        return Progress(
            stage=said.stage,
            done=said.done,
            total=said.total,
            stages_done=place,
            stages=len(stages),
            left_s=None if left is None else round(max(left, 0.0), 1),
        )
