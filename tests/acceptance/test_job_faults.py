"""Jobs of real processes that are killed, paused, starved of disk and store, and outlive their database."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import httpx
import pytest

from service.clouds import write_ply
from service.datasets import Datasets
from service.job_specs import read_spec
from service.labels import Label
from tests.acceptance.jobs_place import PATIENCE, Place, Worker, free_port, wait_until
from tests.acceptance.servers import Postgres, postgres_of_jobs
from worker.simulation import simulate

STEPS = ("gathering clouds", "segments and descriptors", "responses", "publishing")  # the first stage of each step


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Place]:
    place = Place(tmp_path)
    yield place
    place.queue.close()


def labelled(place: Place, name: str = "table") -> None:
    """A dataset of twelve objects of two kinds."""
    datasets = Datasets(place.store.url)
    datasets.create(name)
    for simulated in simulate(12, 4, renderer="raycast", orders=(1, 3)):
        label = Label(category=f"order {simulated.order}")
        datasets.put(name, f"{simulated.index}.ply", write_ply(simulated.cloud), label=label)


def taker(a: Worker, b: Worker) -> tuple[Worker, Worker]:
    """The worker that has taken the job `one`, and the other one."""
    wait_until(lambda: bool(a.said("one") or b.said("one")), "a worker to take the job")
    return (a, b) if a.said("one") else (b, a)


def test_a_dead_workers_job_is_taken_over_without_doing_again_what_was_finished(place: Place) -> None:
    with place.worker("a", "a") as a, place.worker("b", "b") as b:
        for worker in (a, b):
            worker.wait_for("takes jobs from")
        place.submit("one", "--simulate", "12", "--name", "toys")
        first, second = taker(a, b)
        first.wait_for("job one: segments and descriptors")
        first.end(signal.SIGKILL)
        place.until("one", "done")
    noticed = f"worker {first.name} has given no sign of life for 3 s: back in the queue"
    assert second.said("one")[:2] == [noticed, f"taken by worker {second.name}"]
    assert "gathering clouds" not in second.said("one")
    assert place.queue.show("one").worker == second.name
    assert place.store.versions("toys") == [1]
    assert place.told("one").count("gathering clouds") == 1


def test_a_store_that_refuses_while_publishing_loses_nothing(place: Place) -> None:
    blobs = place.folder / "store" / "blobs"
    blobs.parent.mkdir()
    blobs.write_text("no folder")  # what models are written into cannot be made
    place.submit("one", "--simulate", "6", "--name", "toys", "--attempts", "2")
    with place.worker("worker"):
        failed = place.until("one", "failed")
        assert failed.error is not None
        assert failed.error.type == "store-unavailable"
        assert place.store.names() == []
        assert any(line.startswith("tried 1 of 2 times; again in 2 s") for line in place.told("one"))
        blobs.unlink()
        place.jobs("retry", "one")
        place.until("one", "done")
    assert place.store.versions("toys") == [1]
    assert place.store.resolve("toys") == ("toys", 1)
    place.store.load("toys", 1)
    again = place.told("one")[place.told("one").index("queued again") :]
    redone = ["publishing", "published toys:1", "carrying names over"]
    assert again == ["queued again", "taken by worker tested", *redone, "done"]


def followed(port: int, job: str, seen: list[tuple[int, str]]) -> bool:
    """Follows a job after the lines that were seen; returns whether it was told that it is over."""
    headers = {"Last-Event-ID": str(seen[-1][0])} if seen else {}
    kind = ""
    with (
        suppress(httpx.TransportError),  # the service was killed
        httpx.stream("GET", f"http://127.0.0.1:{port}/v1/jobs/{job}/events", headers=headers, timeout=PATIENCE) as told,
    ):
        for line in told.iter_lines():
            field, _, value = line.partition(": ")
            kind = value if field == "event" else kind
            if field == "data" and kind == "log":
                seen.append((json.loads(value)["number"], json.loads(value)["line"]))
            if kind == "end":
                return True
    return False


def test_a_killed_service_disturbs_no_job_and_who_follows_one_misses_nothing(place: Place) -> None:
    port, seen = free_port(), list[tuple[int, str]]()
    place.submit("one", "--simulate", "12", "--name", "toys")
    with place.worker("worker") as worker:
        with place.api(port) as api, ThreadPoolExecutor(1) as threads:
            following = threads.submit(followed, port, "one", seen)
            wait_until(lambda: "gathering clouds" in [line for _, line in seen], "a line of the log")
            api.kill()
            assert following.result() is False
        worker.wait_for("job one: dictionary")
        with place.api(port):
            assert followed(port, "one", seen)
        assert "Traceback" not in worker.log
    assert [number for number, _ in seen] == list(range(1, len(seen) + 1))
    assert [line for _, line in seen] == place.told("one")
    assert seen[-1][1] == "done"


@pytest.mark.slow
def test_a_worker_killed_in_every_stage_goes_on_and_repeats_no_finished_one(place: Place) -> None:
    labelled(place)
    train, judged = ("--simulate", "6", "--name"), ("--labelled", "table")
    kills = [
        ("a", "gathering clouds", (*train, "a", *judged)),
        ("b", "segments and descriptors", (*train, "b", *judged)),
        ("c", "map", (*train, "c", *judged)),
        ("d", "responses", (*train, "d", *judged)),
        ("e", "publishing", (*train, "e", *judged)),
        ("f", "simulating", ("--simulate", "6", "--into", "toys")),
        ("g", "responses", ("--evaluate", "a", "--dataset", "table")),
        ("h", "report", ("--evaluate", "a", "--dataset", "table")),
    ]
    before = ""
    for job, stage, arguments in kills:  # each worker finishes the job of the one before, and is killed in the next
        with place.worker(f"killed-{job}") as worker:
            if before:
                worker.wait_for(f"job {before}: done")
            place.submit(job, *arguments)
            worker.wait_for(f"job {job}: {stage}")
            worker.end(signal.SIGKILL)
        before = job
    with place.worker("last") as worker:
        place.until("h", "done")
    for job, stage, _ in kills:
        found, told = place.queue.show(job), place.told(job)
        assert found.state == "done", found
        again = told[len(told) - told[::-1].index("taken by worker tested") :]
        finished = STEPS[: max((i for i, first in enumerate(STEPS) if first in told[: -len(again) - 1]), default=0)]
        if found.spec.kind == "train":
            assert not set(finished) & set(again), (job, stage, told)
            assert place.store.versions(job) == [1]
            manifest = place.store.manifest(job, 1)
            assert manifest.job == job
            assert manifest.metrics is not None
    assert len(Datasets(place.store.url).entries("toys")) == 6
    reports = [place.folder / "store" / "reports" / job / "report.json" for job in ("g", "h")]
    assert all(report.stat().st_size > 1000 for report in reports)
    assert not list((place.folder / "store").glob("jobs/**/*.*"))


@pytest.mark.slow
def test_a_cancel_takes_effect_within_seconds_in_every_stage_and_a_retry_goes_on(place: Place) -> None:
    labelled(place)
    stages = {
        "gathering clouds": ("--simulate", "200", "--name", "toys"),
        "segments and descriptors": ("--simulate", "60", "--name", "toys"),
        "simulating": ("--simulate", "200", "--into", "toys"),
        "responses": ("--evaluate", "toys", "--dataset", "table", "--robustness"),
    }
    place.submit("first")
    with place.worker("worker") as worker:
        place.until("first", "done")
        for number, (stage, arguments) in enumerate(stages.items()):
            job = f"job-{number}"
            place.submit(job, *arguments)
            worker.wait_for(f"job {job}: {stage}")
            place.queue.cancel(job)
            asked = time.monotonic()
            worker.wait_for(f"job {job}: cancelled")
            assert time.monotonic() - asked < 5
        assert place.store.versions("toys") == [1]
        place.queue.retry("job-1")
        place.until("job-1", "done")
    assert place.told("job-1").count("gathering clouds") == 1
    assert place.store.versions("toys") == [1, 2]


@pytest.mark.slow
def test_a_job_that_takes_too_long_fails_and_has_as_long_again_when_retried(place: Place) -> None:
    place.submit("one", "--simulate", "200", "--name", "toys", "--timeout", "3")
    with place.worker("worker") as worker:
        failed = place.until("one", "failed")
        assert failed.error is not None
        assert failed.error.type == "job-timed-out"
        place.queue.retry("one")
        worker.wait_for("job one: taken by worker tested")
        failed = place.until("one", "failed")
    assert failed.error is not None
    assert "3 s" in failed.error.detail


def children(parent: int) -> list[int]:
    """Processes that a process has started."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            if int(stat.read_text().rpartition(")")[2].split()[1]) == parent:
                found.append(int(stat.parent.name))
    return found


@pytest.mark.slow
def test_a_step_that_is_killed_for_want_of_memory_is_tried_again(place: Place) -> None:
    place.submit("one", "--simulate", "60", "--name", "toys")
    with place.worker("worker") as worker:
        worker.wait_for("job one: gathering clouds")
        steps = [step for server in children(worker.process.pid) for step in children(server)]
        assert len(steps) == 1
        os.kill(steps[0], signal.SIGKILL)
        place.until("one", "done")
    assert any("SIGKILL" in line and "tried 1 of 5 times" in line for line in place.told("one"))
    assert place.store.versions("toys") == [1]


@pytest.mark.slow
def test_a_service_that_ends_lets_those_who_follow_a_job_go(place: Place) -> None:
    port, seen = free_port(), list[tuple[int, str]]()
    place.submit("one")
    place.queue.note("one", "a line")
    with place.api(port) as api, ThreadPoolExecutor(1) as threads:
        following = threads.submit(followed, port, "one", seen)
        wait_until(lambda: bool(seen), "a line of the log")
        told = time.monotonic()
        api.terminate()
        assert following.result() is False
        assert api.wait(PATIENCE) == 0
        assert time.monotonic() - told < 10


@pytest.mark.slow
def test_a_worker_that_was_only_paused_gives_up_what_another_has_taken_over(place: Place) -> None:
    with place.worker("a", "a") as a, place.worker("b", "b") as b:
        for worker in (a, b):
            worker.wait_for("takes jobs from")
        place.submit("one", "--simulate", "12", "--name", "toys")
        paused, other = taker(a, b)
        paused.signal(signal.SIGSTOP)
        other.wait_for("job one: taken by worker")
        paused.signal(signal.SIGCONT)
        place.until("one", "done")
        place.submit("two", "--simulate", "2", "--into", "toys")
        place.until("two", "done")
        assert paused.process.poll() is None
        assert "job one: done" not in paused.log
    assert place.store.versions("toys") == [1]


@pytest.mark.parametrize("count", [4, pytest.param(20, marks=pytest.mark.slow)])
def test_two_workers_share_a_queue_and_do_no_job_twice(place: Place, count: int) -> None:
    share_a_queue(place, count)


def share_a_queue(place: Place, count: int) -> None:
    """Small jobs, every fourth of which trains."""
    jobs = [f"job-{number:02}" for number in range(count)]
    versions = list(range(1, len(jobs[::4]) + 1))
    for number, job in enumerate(jobs):
        train = {"name": "toys", "simulate": 4}
        given = train if number % 4 == 0 else {"kind": "simulate", "dataset": f"set-{number}", "count": 2}
        place.queue.submit(read_spec({**given, "simulation": {"renderer": "raycast"}}), job)
    with place.worker("first", "first") as first, place.worker("second", "second") as second:
        for job in jobs:
            assert place.until(job, "done").state == "done"
        taken = re.findall(r"job (\S+): taken", first.log + second.log)
        assert first.log.count(": done") + second.log.count(": done") == count
        assert min(first.log.count(": done"), second.log.count(": done")) >= count // 6
    assert sorted(taken) == jobs
    assert place.store.versions("toys") == versions
    assert sorted(str(place.store.manifest("toys", version).job) for version in versions) == jobs[::4]
    assert len(Datasets(place.store.url).names()) == count - len(versions)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 16 MiB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    if os.getuid() != 0 or not shutil.which("mount"):
        pytest.skip("only root can mount a small file system")
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=16m", "tmpfs", folder], capture_output=True)
    if mounted.returncode != 0:
        pytest.skip(f"no file system can be mounted here: {mounted.stderr.decode()}")
    yield folder
    subprocess.run(["umount", "--lazy", folder], check=True)


@pytest.mark.slow
def test_a_full_disk_while_publishing_leaves_no_half_version_and_loses_no_job(tmp_path: Path, small_disk: Path) -> None:
    place = Place(tmp_path, store=small_disk / "store")
    place.submit("first")
    with place.worker("worker") as worker:
        place.until("first", "done")
        [blob] = (small_disk / "store" / "blobs" / "sha256").iterdir()
        clouds = 6 * 2**19  # more than the clouds of a job take
        # Room for the clouds and for the model as it is learnt, but not for another one where it is published.
        free = shutil.disk_usage(small_disk).free
        (small_disk / "filler").write_bytes(bytes(free - clouds))
        place.submit("second", "--simulate", "6", "--seed", "8", "--name", "toys", "--attempts", "2")
        worker.wait_for("job second: dictionary", "job second: failed")
        rest = shutil.disk_usage(small_disk).free
        (small_disk / "more").write_bytes(bytes(max(0, rest - int(1.5 * blob.stat().st_size))))
        failed = place.until("second", "failed")
        assert failed.error is not None
        assert failed.error.type == "store-unavailable"
        assert place.store.versions("toys") == [1]
        assert place.store.resolve("toys") == ("toys", 1)
        (small_disk / "filler").unlink()
        place.jobs("retry", "second")
        place.until("second", "done")
    assert place.told("second").count("gathering clouds") == 1
    assert place.store.versions("toys") == [1, 2]
    place.store.load("toys", 2)
    place.queue.close()


def fill(file: Path) -> None:
    """Writes a file until the disk is full."""
    with suppress(OSError), file.open("wb", buffering=0) as filler:
        while True:
            filler.write(bytes(4096))


@pytest.mark.slow
def test_a_full_disk_under_the_database_loses_no_job(tmp_path: Path, small_disk: Path) -> None:
    place = Place(tmp_path, jobs_url=f"sqlite:///{small_disk / 'jobs.sqlite'}")
    place.submit("one")
    with place.worker("worker") as worker:
        worker.wait_for("job one: gathering clouds")
        fill(small_disk / "filler")
        time.sleep(6)
        (small_disk / "filler").unlink()
        place.until("one", "done")
    assert place.store.versions("toys") == [1]
    place.queue.close()


@pytest.fixture
def postgres() -> Iterator[Postgres]:
    with postgres_of_jobs() as server:
        yield server


def test_a_job_outlives_a_restart_of_its_database(tmp_path: Path, postgres: Postgres) -> None:
    place = Place(tmp_path, jobs_url=postgres.url)
    place.submit("one", "--simulate", "12", "--name", "toys")
    with place.worker("worker") as worker:
        worker.wait_for("job one: gathering clouds")
        postgres.stop()
        postgres.start()
        place.until("one", "done")
    assert place.store.versions("toys") == [1]
    place.queue.close()


@pytest.mark.slow
def test_jobs_outlive_a_crash_of_their_database(tmp_path: Path, postgres: Postgres) -> None:
    place = Place(tmp_path, jobs_url=postgres.url)
    place.submit("one", "--simulate", "40", "--name", "toys")
    place.submit("two")
    with place.worker("worker") as worker:
        worker.wait_for("job one: gathering clouds")
        postgres.stop()
        assert place.ask("show", "one").returncode == 1
        time.sleep(5)  # longer than the lease
        postgres.start()
        worker.wait_for("job one: segments and descriptors")
        postgres.stop()
        postgres.start()
        place.until("two", "done")
        place.until("one", "done")
    assert place.store.versions("toys") == [1, 2]
    assert place.told("one").count("taken by worker tested") == 1
    place.queue.close()


@pytest.mark.slow
def test_two_workers_share_a_queue_in_postgres(tmp_path: Path, postgres: Postgres) -> None:
    place = Place(tmp_path, jobs_url=postgres.url)
    share_a_queue(place, 20)
    place.queue.close()
