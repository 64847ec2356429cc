"""Retraining with real processes: on schedule, from an old model's sources, promoted by rule, and taken back."""

from __future__ import annotations

import json
import signal
import sqlite3
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from service.clouds import write_ply
from service.cron import read_cron
from service.datasets import Datasets
from service.job_specs import read_spec
from service.jobs import Jobs
from service.labels import Label
from service.schedules import Schedules, id_of
from tests.acceptance.jobs_place import Place
from tests.acceptance.servers import postgres_of_jobs
from tests.learnt import objects
from worker.scheduling import Scheduling

RAYCAST = {"renderer": "raycast"}


@pytest.fixture
def place(tmp_path: Path) -> Place:
    return Place(tmp_path)


def command(place: Place, *arguments: str) -> dict[str, Any]:
    asked = subprocess.run(
        [sys.executable, "-m", "service.cli", *arguments, "--json"],
        env=place.environment,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert asked.returncode == 0, asked.stderr
    told: dict[str, Any] = json.loads(asked.stdout)
    return told


def test_times_that_were_missed_are_made_good_once_by_two_workers(place: Place) -> None:
    schedules = Schedules(place.queue)
    spec = read_spec({"name": "toys", "simulate": 3, "simulation": RAYCAST})
    schedules.create("hourly", read_cron("0 * * * *"), spec)
    with sqlite3.connect(place.folder / "queue" / "jobs.sqlite") as database:  # as if no worker had run for a while
        database.execute("UPDATE shape_concepts_schedule SET since = since - 5 * 3600")
    database.close()
    with place.worker("one", "one") as one, place.worker("two", "two") as two:
        for worker in (one, two):
            worker.wait_for("takes jobs from")
        while (job := schedules.show("hourly").last_job) is None:
            time.sleep(0.1)
        done = place.until(job, "done")
        assert done.result is not None
        assert [worker.end(signal.SIGTERM) for worker in (one, two)] == [0, 0]
    with place.worker("again", "one") as again:
        again.wait_for("takes jobs from")
        time.sleep(3)
        assert again.end(signal.SIGTERM) == 0
    assert [entry.id for entry in place.queue.page().jobs] == [job]
    assert place.store.versions("toys") == [1]
    assert command(place, "schedules", "show", "hourly")["last_job"] == job


@pytest.mark.slow
def test_a_model_is_extended_judged_promoted_and_taken_back(place: Place) -> None:
    datasets = Datasets(place.store.url)
    datasets.create("table")
    for simulated in objects(12):
        label = Label(category=f"order {simulated.index % 2}")
        datasets.put("table", f"{simulated.index}.ply", write_ply(simulated.cloud), label=label)
    place.queue.submit(read_spec({"name": "toys", "simulate": 8, "simulation": RAYCAST}), "one")
    more = {"name": "toys", "extend": "toys", "datasets": ["table"], "labelled": "table"}
    with place.worker("first") as worker:
        place.until("one", "done")
        for concept in place.store.load("toys", 1)[0].spectrum().ids.tolist():
            place.store.concept_names("toys", 1).change({concept: f"thing {concept}"})
        place.queue.submit(read_spec(more | {"promote": "not-worse", "tolerance": 1.0}), "two")
        worker.wait_for("job two: judging both versions")
        assert place.store.aliases("toys") == {"production": 1}
        assert worker.end(signal.SIGKILL) == -signal.SIGKILL
    with place.worker("second") as worker:
        result = place.until("two", "done").result
        assert "learning" not in worker.log
        assert worker.end(signal.SIGTERM) == 0
    assert result is not None
    assert result.kind == "train"
    assert (result.version, result.parent, result.clouds, result.promoted) == (2, "toys:1", 20, True)
    assert len(result.reasons) == 5
    assert place.store.versions("toys") == [1, 2]
    manifest = place.store.manifest("toys", 2)
    assert [part["kind"] for part in manifest.source["parts"]] == ["simulation", "dataset"]
    assert set(manifest.metrics or {}) == {"knn", "svm", "within", "assigned", "answered"}
    names = place.store.concept_names("toys", 2).read()
    assert set(names.carried.values()) <= {"toys:1"}
    assert set(names.of) == set(names.carried)
    told = command(place, "models", "compare", "toys:1", "toys:2")
    assert {same["new"]: same["old_name"] for same in told["same_concepts"]} == names.of
    assert command(place, "models", "rollback", "toys")["version"] == 1


@pytest.mark.slow
def test_on_postgres_several_workers_make_one_job_of_a_due_time_too() -> None:
    with postgres_of_jobs() as server:
        jobs = Jobs(server.url)
        schedules = Schedules(jobs)
        hourly = read_cron("0 * * * *")
        made = schedules.create("hourly", hourly, read_spec({"name": "toys", "simulate": 3}))
        assert schedules.create("hourly", hourly, made.job) == made
        due = hourly.next(made.since)
        workers = [Scheduling(Jobs(server.url)) for _ in range(4)]
        with ThreadPoolExecutor(4) as threads:
            list(threads.map(lambda worker: worker.look(due), workers))
        assert [job.id for job in jobs.page().jobs] == [id_of(made, due)] == [schedules.show("hourly").last_job]
        schedules.pause("hourly")
        assert schedules.resume("hourly").since > made.since
        schedules.delete("hourly")
        assert schedules.all() == []
