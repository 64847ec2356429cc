"""The queue of jobs, as those who ask see it; no worker is needed for that."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from service.engine.errors import InvalidParameter, JobNotFound, JobsUnavailable
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
    ids = [jobs.submit(SPEC, job_id).id for job_id in ("a", "b", "c")]
    assert [job.id for job in jobs.recent()] == ids[::-1]
    assert [job.id for job in jobs.recent(limit=2)] == ["c", "b"]


def test_submitted_twice_under_one_id_it_is_one_job(jobs: Jobs) -> None:
    assert jobs.submit(SPEC, "nightly") == jobs.submit(SPEC, "nightly")
    assert len(jobs.recent()) == 1


def test_another_job_under_the_same_id_is_refused(jobs: Jobs) -> None:
    jobs.submit(SPEC, "nightly")
    with pytest.raises(InvalidParameter, match="nightly"):
        jobs.submit(read_spec({"name": "toys", "simulate": 3}), "nightly")
    assert jobs.show("nightly").spec == SPEC


def test_a_cancelled_job_stays_cancelled(jobs: Jobs) -> None:
    jobs.submit(SPEC, "nightly")
    assert jobs.cancel("nightly").state == jobs.cancel("nightly").state == "cancelled"


def test_looking_makes_no_database(jobs: Jobs, tmp_path: Path) -> None:
    assert jobs.recent() == []
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
        Jobs("postgresql://worker:secret@127.0.0.1:1/jobs").recent()
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
        "assert [model.name for model in application.models()] == ['default']\n"
        "try: application.submit(read_spec({'name': 'toys', 'simulate': 2}))\n"
        "except Exception as error: print(error)\n"
    )
    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    assert "shape-concepts[jobs]" in told.stdout, told.stderr
