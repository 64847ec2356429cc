"""Schedules in the database of the jobs, and what workers make of them."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from service.cron import read_cron
from service.engine.errors import InvalidParameter, JobsUnavailable, ScheduleExists, ScheduleNotFound
from service.job_specs import read_spec
from service.jobs import Jobs
from service.schedules import Schedules, id_of
from worker.scheduling import Scheduling

SPEC = read_spec({"name": "toys", "simulate": 2})
HOURLY = read_cron("0 * * * *")
HOUR = timedelta(hours=1)


@pytest.fixture
def jobs(tmp_path: Path) -> Iterator[Jobs]:
    jobs = Jobs(f"sqlite:///{tmp_path / 'jobs.sqlite'}")
    yield jobs
    jobs.close()


@pytest.fixture
def schedules(jobs: Jobs) -> Iterator[Schedules]:
    schedules = Schedules(jobs)
    yield schedules
    schedules.close()


def due(hours: int) -> datetime:
    """The so-manieth whole hour from now on."""
    return HOURLY.next(datetime.now(UTC)) + (hours - 1) * HOUR


def test_to_look_makes_no_database(schedules: Schedules, tmp_path: Path) -> None:
    assert schedules.all() == []
    assert not (tmp_path / "jobs.sqlite").exists()
    with pytest.raises(ScheduleNotFound):
        schedules.show("hourly")


def test_a_schedule_is_kept_as_it_was_made_and_made_again_the_same(schedules: Schedules, jobs: Jobs) -> None:
    made = schedules.create("hourly", HOURLY, SPEC)
    assert (made.state, made.job, made.next_due, made.last_due, made.last_job) == ("active", SPEC, due(1), None, None)
    assert schedules.create("hourly", HOURLY, SPEC) == made == Schedules(jobs).show("hourly")
    assert schedules.all() == [made]
    with pytest.raises(ScheduleExists):
        schedules.create("hourly", read_cron("1 * * * *"), SPEC)
    with pytest.raises(ScheduleExists):
        schedules.create("hourly", HOURLY, read_spec({"name": "toys", "simulate": 3}))
    schedules.delete("hourly")
    assert schedules.all() == []
    with pytest.raises(ScheduleNotFound):
        schedules.delete("hourly")


@pytest.mark.parametrize("name", ["", "Hourly", "a b", "-x", "x" * 41])
def test_a_name_that_no_job_could_bear_is_refused(schedules: Schedules, name: str) -> None:
    with pytest.raises(InvalidParameter, match="name of a schedule"):
        schedules.create(name, HOURLY, SPEC)


def test_a_job_is_submitted_once_a_due_time_and_none_before(schedules: Schedules, jobs: Jobs) -> None:
    made, worker = schedules.create("hourly", HOURLY, SPEC), Scheduling(jobs)
    assert worker.look(datetime.now(UTC)) == []
    (job,) = worker.look(due(1))
    assert job == id_of(made, due(1))
    assert worker.look(due(1)) == worker.look(due(1) + HOUR / 2) == []
    assert (jobs.show(job).spec, jobs.show(job).state) == (SPEC, "queued")
    assert (schedules.show("hourly").last_job, schedules.show("hourly").last_due) == (job, due(1))
    jobs.cancel(job)
    assert worker.look(due(2)) == [id_of(made, due(2))]
    assert len(jobs.page().jobs) == 2


def test_of_several_workers_one_job_comes_of_it(schedules: Schedules, jobs: Jobs) -> None:
    made = schedules.create("hourly", HOURLY, SPEC)
    workers = [Scheduling(Jobs(jobs.url)) for _ in range(4)]
    with ThreadPoolExecutor(4) as threads:
        list(threads.map(lambda worker: worker.look(due(1)), workers))
    assert [job.id for job in jobs.page().jobs] == [id_of(made, due(1))]


def test_times_that_were_missed_are_made_good_by_one_job(schedules: Schedules, jobs: Jobs) -> None:
    made, worker = schedules.create("hourly", HOURLY, SPEC), Scheduling(jobs)
    assert worker.look(due(9)) == [id_of(made, due(9))]
    assert worker.look(due(9) + HOUR / 2) == []


def test_while_a_job_is_under_way_the_next_one_waits(schedules: Schedules, jobs: Jobs) -> None:
    made, worker = schedules.create("hourly", HOURLY, SPEC), Scheduling(jobs)
    (job,) = worker.look(due(1))
    assert worker.look(due(2)) == worker.look(due(3)) == []
    jobs.cancel(job)
    assert worker.look(due(3)) == [id_of(made, due(3))]


def test_a_worker_whose_clock_is_behind_submits_nothing_twice(schedules: Schedules, jobs: Jobs) -> None:
    schedules.create("hourly", HOURLY, SPEC)
    (job,) = Scheduling(jobs).look(due(2))
    jobs.cancel(job)
    assert Scheduling(jobs).look(due(1)) == []


def test_a_pause_counts_for_nothing(schedules: Schedules, jobs: Jobs) -> None:
    schedules.create("hourly", HOURLY, SPEC)
    assert schedules.pause("hourly").state == schedules.pause("hourly").state == "paused"
    assert schedules.show("hourly").next_due is None
    assert Scheduling(jobs).look(due(5)) == []
    resumed = schedules.resume("hourly")
    assert resumed.state == "active"
    assert schedules.resume("hourly").since == resumed.since
    assert Scheduling(jobs).look(datetime.now(UTC)) == []
    assert Scheduling(jobs).look(due(1)) == [id_of(resumed, due(1))]


def test_a_job_that_cannot_be_submitted_is_told_and_keeps_no_later_one(schedules: Schedules, jobs: Jobs) -> None:
    made, worker = schedules.create("hourly", HOURLY, SPEC), Scheduling(jobs)
    jobs.submit(read_spec({"name": "other", "simulate": 2}), id_of(made, due(1)))
    assert worker.look(due(1)) == []
    told = schedules.show("hourly")
    assert told.last_job is None
    assert "another job of the id" in (told.fault or "")
    assert worker.look(due(2)) == [id_of(made, due(2))]
    assert schedules.show("hourly").fault is None


def test_a_database_out_of_reach_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no database, but long enough to be read as one" * 100)
    with pytest.raises(JobsUnavailable):
        Schedules(Jobs(f"sqlite:///{tmp_path / 'file'}")).all()
