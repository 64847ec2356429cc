"""What a job tells reaches the database, also one that was out of reach for a while."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from service.job_records import JobRecords
from service.jobs import prepare
from worker.apart import Count
from worker.job_report import JobReport

STAGES = {"first": 0.5, "second": 0.5}


@pytest.fixture
def records(tmp_path: Path) -> Iterator[JobRecords]:
    url = f"sqlite:///{tmp_path / 'jobs.sqlite'}"
    prepare(url)
    records = JobRecords(url)
    yield records
    records.close()


def test_lines_and_progress_are_written_together(records: JobRecords) -> None:
    report = JobReport(records, "one", STAGES, time.time() - 30)
    for done in range(3):
        report.tell(Count("first", done, 4))
    report.tell("halfway through the first")
    report.write()
    assert [line.line for line in records.lines("one")] == ["first", "halfway through the first"]
    progress = records.progress(["one", "another"])["one"]
    assert (progress.stage, progress.done, progress.total, progress.stages_done, progress.stages) == (
        "first",
        2,
        4,
        0,
        2,
    )
    assert progress.left_s == pytest.approx(90, abs=5)  # a quarter took 30 s


def test_the_time_left_is_not_told_before_it_can_be_known(records: JobRecords) -> None:
    report = JobReport(records, "one", STAGES, time.time())
    report.tell(Count("first", 0, None))
    report.write()
    assert records.progress(["one"])["one"].left_s is None
    report.tell(Count("second", 0, None))
    report.write()
    assert records.progress(["one"])["one"].left_s is not None


def test_what_cannot_be_written_is_written_next_time_and_once(records: JobRecords, tmp_path: Path) -> None:
    report = JobReport(records, "one", STAGES, time.time())
    report.tell("a line")
    report.tell(Count("first", 1, 2))
    records.close()
    (tmp_path / "jobs.sqlite").rename(tmp_path / "away")
    with pytest.raises(Exception, match="no such table"):
        report.write()
    records.close()
    (tmp_path / "away").replace(tmp_path / "jobs.sqlite")
    report.write()
    report.write()
    assert [line.line for line in records.lines("one")] == ["a line", "first"]
    assert records.progress(["one"])["one"].done == 1


def test_a_job_is_begun_once_unless_it_is_begun_anew(records: JobRecords) -> None:
    begun = records.begun("one")
    assert records.begun("one") == begun
    records.begin_anew("one")
    assert records.begun("one") > begun


def test_workers_that_ended_give_no_sign_of_life(records: JobRecords) -> None:
    records.beat("a", "1")
    records.beat("b", "1")
    records.beat("a", "2")
    records.ended("b")
    assert records.beats() == {"a": "2"}
