"""Jobs with real processes: submitted, done, broken off in every way, and still done once."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.acceptance.jobs_place import PATIENCE, Place


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Place]:
    place = Place(tmp_path)
    yield place
    place.queue.close()


def test_a_job_broken_off_again_and_again_publishes_one_version(place: Place) -> None:
    place.submit("one")
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
        place.until("one", "done")
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
    again = place.ask("retry", "one")
    assert (again.returncode, "is done" in again.stderr) == (1, True)
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
