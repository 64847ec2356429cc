"""The queue of jobs, as those who ask see it; no worker is needed for that."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from service.engine.errors import InvalidParameter, JobNotFound, JobsUnavailable
from service.job_records import JobRecords
from service.job_specs import read_spec
from service.jobs import Jobs

SPEC = read_spec({"name": "toys", "simulate": 2})


@pytest.fixture
def jobs(tmp_path: Path) -> Iterator[Jobs]:
    jobs = Jobs(f"sqlite:///{tmp_path / 'made' / 'jobs.sqlite'}")
    yield jobs
    jobs.close()


def test_a_job_is_queued_as_it_was_submitted(jobs: Jobs) -> None:
    submitted = jobs.submit(SPEC)
    assert (submitted.state, submitted.spec) == ("queued", SPEC)
    assert jobs.show(submitted.id) == submitted


def test_jobs_are_listed_newest_first(jobs: Jobs) -> None:
    ids = [jobs.submit(SPEC, job_id).id for job_id in ("a", "b", "c", "d", "e")]
    assert [job.id for job in jobs.page().jobs] == ids[::-1]
    pages, before = [], None
    while not pages or before is not None:
        page = jobs.page(2, before)
        pages.append([job.id for job in page.jobs])
        before = page.next
    assert pages == [["e", "d"], ["c", "b"], ["a"]]


def test_jobs_of_one_state_are_listed(jobs: Jobs) -> None:
    for job_id in ("a", "b", "c"):
        jobs.submit(SPEC, job_id)
    jobs.cancel("b")
    assert [job.id for job in jobs.page(state="queued").jobs] == ["c", "a"]
    assert [job.id for job in jobs.page(state="cancelled").jobs] == ["b"]
    assert [job.id for job in jobs.page(before="b", state="queued").jobs] == ["a"]
    with pytest.raises(JobNotFound):
        jobs.page(before="z")


@pytest.mark.parametrize("other", [{"name": "other", "simulate": 2}, {"kind": "simulate", "dataset": "x", "count": 2}])
def test_another_job_under_the_id_is_refused_whatever_its_kind(jobs: Jobs, other: dict[str, Any]) -> None:
    jobs.submit(SPEC, "nightly")
    with pytest.raises(InvalidParameter, match="another job of the id 'nightly'"):
        jobs.submit(read_spec(other), "nightly")
    assert [job.spec for job in jobs.page().jobs] == [SPEC]


def test_a_cancelled_job_tells_when_it_was_begun(jobs: Jobs) -> None:
    jobs.submit(SPEC, "nightly")
    begun = jobs.records.begun("nightly")
    jobs.cancel("nightly")
    started = jobs.show("nightly").started
    assert started is not None
    assert started.timestamp() == pytest.approx(begun)


def test_submitted_twice_under_one_id_it_is_one_job(jobs: Jobs) -> None:
    assert jobs.submit(SPEC, "nightly") == jobs.submit(SPEC, "nightly")
    assert len(jobs.page().jobs) == 1


def test_another_job_under_the_same_id_is_refused(jobs: Jobs) -> None:
    jobs.submit(SPEC, "nightly")
    with pytest.raises(InvalidParameter, match="nightly"):
        jobs.submit(read_spec({"name": "toys", "simulate": 3}), "nightly")
    assert jobs.show("nightly").spec == SPEC


def test_a_cancelled_job_stays_cancelled(jobs: Jobs) -> None:
    jobs.submit(SPEC, "nightly")
    assert jobs.cancel("nightly").state == jobs.cancel("nightly").state == "cancelled"


def test_a_cancelled_job_is_queued_again_by_a_retry_and_a_queued_one_left_alone(jobs: Jobs) -> None:
    jobs.submit(SPEC, "nightly")
    assert jobs.retry("nightly").state == "queued"
    jobs.cancel("nightly")
    assert jobs.retry("nightly").state == jobs.retry("nightly").state == "queued"
    assert [line.line for line in jobs.look("nightly").lines] == ["cancelled", "queued again"]


def test_lines_of_a_log_are_numbered_without_a_gap_whoever_writes_them(jobs: Jobs) -> None:
    jobs.submit(SPEC, "nightly")
    writers = [JobRecords(jobs.url) for _ in range(4)]
    with ThreadPoolExecutor(4) as threads:
        list(threads.map(lambda records: [records.write("nightly", [(0.0, "line")]) for _ in range(10)], writers))
    assert [line.number for line in jobs.look("nightly").lines] == list(range(1, 41))
    assert [line.number for line in jobs.look("nightly", after=38).lines] == [39, 40]
    for records in writers:
        records.close()


def test_a_job_that_nobody_submitted_cannot_be_looked_at_or_retried(jobs: Jobs) -> None:
    for ask in (jobs.show, jobs.look, jobs.retry):
        with pytest.raises(JobNotFound):
            ask("nightly")


def test_looking_makes_no_database(jobs: Jobs, tmp_path: Path) -> None:
    assert jobs.page().jobs == []
    with pytest.raises(JobNotFound, match="nightly"):
        jobs.show("nightly")
    with pytest.raises(JobNotFound):
        jobs.cancel("nightly")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({}, "at least one of"),
        ({"datasets": ["a", "b", "a"]}, "twice"),
        ({"datasets": ["Not A Name"]}, "datasets.0"),
        ({"kind": "evaluate"}, "model"),
        ({"kind": "paint"}, "kind"),
        ({"simulate": 2, "parent": "toys:x"}, "parent"),
        ({"simulate": 2, "timeout": 0}, "timeout"),
        ({"simulate": 1}, "simulate"),
        ({"simulate": 2, "seed": -1}, "seed"),
        ({"simulate": 2, "alias": "Not A Name"}, "alias"),
        ({"simulate": 2, "speed": 3}, "speed"),
        ({"simulate": 2, "params": {"patches": {"iterations": 0}}}, "params.patches.iterations"),
    ],
)
def test_a_job_that_cannot_be_is_refused(given: dict[str, object], told: str) -> None:
    with pytest.raises(InvalidParameter, match=told):
        read_spec({"name": "toys"} | given)


@pytest.mark.parametrize("job_id", ["", "../up", "Upper", "a" * 64])
def test_an_id_that_cannot_be_is_refused(jobs: Jobs, job_id: str) -> None:
    with pytest.raises(InvalidParameter):
        jobs.submit(SPEC, job_id or " ")


@pytest.mark.parametrize("url", ["jobs.sqlite", "sqlite:///", "mysql://root@host/jobs", ""])
def test_what_is_no_database_is_refused(url: str) -> None:
    with pytest.raises(JobsUnavailable, match="sqlite:///FILE"):
        Jobs(url).submit(SPEC)


def test_a_database_out_of_reach_is_told_without_its_password() -> None:
    with pytest.raises(JobsUnavailable) as told:
        Jobs("postgresql://worker:secret@127.0.0.1:1/jobs").page()
    assert "127.0.0.1" in str(told.value)
    assert "secret" not in str(told.value)


def test_a_file_that_is_no_database_is_told(tmp_path: Path) -> None:
    (tmp_path / "jobs.sqlite").write_text("no database at all " * 100)
    with pytest.raises(JobsUnavailable, match="not a database"):
        Jobs(f"sqlite:///{tmp_path / 'jobs.sqlite'}").submit(SPEC)


def test_the_service_starts_without_the_job_engine_and_says_what_to_install(tmp_path: Path) -> None:
    program = (
        "import sys; sys.modules['dbos'] = None\n"
        "from service.application import Application; from service.job_specs import read_spec\n"
        "from service.settings import Settings\n"
        f"application = Application(Settings(store={str(tmp_path)!r}, jobs_url='sqlite:///{tmp_path}/jobs.sqlite'))\n"
        "assert [model.name for model in application.models.all()] == ['default']\n"
        "try: application.training.submit(read_spec({'name': 'toys', 'simulate': 2}))\n"
        "except Exception as error: print(error)\n"
    )
    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    assert "shape-concepts[jobs]" in told.stdout, told.stderr
