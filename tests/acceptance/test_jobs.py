"""Jobs with real processes: submitted, done, broken off in every way, and still done once."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from service.store import ModelStore

PATIENCE = 120.0  # seconds that anything may take


class Place:
    """A store and a queue of their own, and the processes that use them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.store = ModelStore(folder / "store")
        given = {"STORE": folder / "store", "JOBS_URL": f"sqlite:///{folder / 'queue' / 'jobs.sqlite'}"}
        plain = {name: value for name, value in os.environ.items() if not name.startswith("SHAPE_CONCEPTS_")}
        self.environment = plain | {f"SHAPE_CONCEPTS_{name}": str(value) for name, value in given.items()}

    def jobs(self, *arguments: str) -> dict[str, Any]:
        command = [sys.executable, "-m", "service.cli", "jobs", *arguments, "--json"]
        asked = subprocess.run(command, env=self.environment, capture_output=True, text=True, timeout=PATIENCE)
        assert asked.returncode == 0, asked.stderr
        answer: dict[str, Any] = json.loads(asked.stdout)
        return answer

    @contextmanager
    def worker(self, log: str) -> Iterator[Worker]:
        """A worker process; what is left of it and of its helpers in the end is killed."""
        file = self.folder / f"{log}.log"
        command = [sys.executable, "-m", "worker.cli", "run", "--worker", "tested", "--workers", "2"]
        with file.open("w") as stderr:
            process = subprocess.Popen(command, env=self.environment, stderr=stderr, start_new_session=True)
        try:
            yield Worker(process, file)
        finally:
            with suppress(ProcessLookupError):  # those that a killed worker computed with are of its group
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


class Worker:
    """A worker process and what it logs."""

    def __init__(self, process: subprocess.Popen[bytes], file: Path) -> None:
        self.process, self.file = process, file

    @property
    def log(self) -> str:
        return self.file.read_text()

    def wait_for(self, line: str) -> None:
        until = time.monotonic() + PATIENCE
        while line not in self.log:
            running = self.process.poll() is None and time.monotonic() < until
            assert running, f"no '{line}' in:\n{self.log}"
            time.sleep(0.02)

    def end(self, number: signal.Signals) -> int:
        self.process.send_signal(number)
        return self.process.wait(PATIENCE)


@pytest.fixture
def place(tmp_path: Path) -> Place:
    return Place(tmp_path)


def test_a_job_broken_off_again_and_again_publishes_one_version(place: Place) -> None:
    place.jobs("submit", "--simulate", "6", "--renderer", "raycast", "--name", "toys", "--id", "one")
    with place.worker("first") as worker:
        worker.wait_for("job one: gathering clouds")
        assert worker.end(signal.SIGTERM) == 0
        assert "job one: broken off" in worker.log
    assert place.jobs("show", "one")["state"] == "queued"

    with place.worker("second") as worker:
        worker.wait_for("job one: dictionary")
        assert worker.end(signal.SIGKILL) == -signal.SIGKILL
        assert "job one: gathering clouds" in worker.log

    with place.worker("third") as worker:
        worker.wait_for("job one: done")
        assert "gathering clouds" not in worker.log  # it was finished before
        assert worker.end(signal.SIGINT) == 0

    job = place.jobs("show", "one")
    assert job["state"] == "done"
    assert job["result"] == {
        "kind": "train",
        "model": "toys",
        "version": 1,
        "parent": None,
        "metrics": None,
        "names_carried": 0,
        "promoted": True,
        "reasons": [],
        "clouds": 6,
        "left_out": 0,
    }
    assert place.store.versions("toys") == [1]
    assert place.store.resolve("toys") == ("toys", 1)
    assert not list((place.folder / "store").glob("jobs/**/*.*"))


def test_a_failure_is_told_and_the_next_job_is_done(place: Place) -> None:
    place.jobs("submit", "--clouds", str(place.folder / "nowhere"), "--name", "toys", "--id", "lost")
    place.jobs("submit", "--simulate", "2", "--renderer", "raycast", "--name", "toys", "--id", "unwanted")
    place.jobs("submit", "--simulate", "200", "--renderer", "raycast", "--name", "toys", "--id", "long")
    assert place.jobs("cancel", "unwanted")["state"] == "cancelled"
    with place.worker("worker") as worker:
        worker.wait_for("job long: gathering clouds")
        assert place.jobs("cancel", "long")["state"] == "cancelled"
        worker.wait_for("job long: cancelled")
        assert worker.end(signal.SIGTERM) == 0
        assert "unwanted" not in worker.log
        assert "Traceback" not in worker.log
    lost = place.jobs("show", "lost")
    assert lost["state"] == "failed"
    assert lost["error"]["type"] == "invalid-parameter"
    assert "nowhere" in lost["error"]["detail"]
    assert [job["id"] for job in place.jobs("list")["jobs"]] == ["long", "unwanted", "lost"]
    assert place.store.names() == []


def test_a_second_worker_of_the_same_name_is_refused(place: Place) -> None:
    with place.worker("first") as first:
        first.wait_for("takes jobs from")
        with place.worker("second") as second:
            assert second.process.wait(PATIENCE) == 1
            assert "--worker" in second.log
        assert first.end(signal.SIGTERM) == 0
