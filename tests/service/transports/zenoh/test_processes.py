"""Replicas as processes, one of which is killed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
import zenoh

from service.clouds import write_ply
from service.engine.cloud import PointCloud
from service.settings import Settings
from tests.service.transports.zenoh.conftest import put, replicas
from tests.service.transports.zenoh.test_answering import Heard, hearing, numbered
from tests.service.transports.zenoh.waiting import until


@contextmanager
def process(settings: Settings, endpoint: str, log: Path, **more: str) -> Iterator[subprocess.Popen[bytes]]:
    """A replica in a process of its own."""
    given = {
        "store": settings.store,
        "zenoh_connect": endpoint,
        "streams": json.dumps([{"key": "robots/*/cloud"}]),
        "workers": "1",
    }
    environment = os.environ | {f"SHAPE_CONCEPTS_{name.upper()}": value for name, value in (given | more).items()}
    command = [sys.executable, "-m", "service.cli", "serve", "--port", "0", "--grpc-port", "-1"]
    with log.open("wb") as stderr, subprocess.Popen(command, stderr=stderr, env=environment) as started:
        try:
            yield started
        finally:
            started.kill()


def test_a_killed_replica_is_replaced_within_seconds_and_nothing_is_answered_twice(
    settings: Settings, endpoint: str, robot: zenoh.Session, clouds: list[PointCloud], tmp_path: Path
) -> None:
    content = write_ply(clouds[0])
    keys = [f"robots/{number}/cloud" for number in range(6)]
    with ExitStack() as stack:
        first, second = (
            stack.enter_context(process(settings, endpoint, tmp_path / f"{name}.log")) for name in ("first", "second")
        )
        until(lambda: len(replicas(robot)) == 2, "both replicas are there", 60)
        heard = stack.enter_context(hearing(robot, "robots/*/cloud/concepts"))
        sequence = 0
        for sequence in range(1, 4):
            _one_each(robot, keys, content, sequence, heard)
        first.kill()
        first.wait()
        killed = time.monotonic()
        last: dict[str, int] = {}
        while len(last) < len(keys):
            assert time.monotonic() - killed < 10
            sequence += 1
            for key in keys:
                put(robot, key, content, attachment=numbered(sequence))
            time.sleep(0.3)
            last = {answer.key: 1 for answer in heard if answer.document["source"]["sequence"] > 3}
        time.sleep(1)
        answered = [(answer.key, answer.document["source"]["sequence"]) for answer in heard]
        assert len(set(answered)) == len(answered)
        assert len(replicas(robot)) == 1
        second.terminate()
        assert second.wait(20) == 0
        assert not replicas(robot)
    assert b"Traceback" not in (tmp_path / "second.log").read_bytes()


def _one_each(robot: zenoh.Session, keys: list[str], content: bytes, sequence: int, heard: list[Heard]) -> None:
    """Publishes a cloud on each key, and waits for as many answers."""
    before = len(heard)
    for key in keys:
        put(robot, key, content, attachment=numbered(sequence))
    until(lambda: len(heard) == before + len(keys), "an answer to each", 60)


def test_a_misconfigured_replica_does_not_start_and_says_why(settings: Settings, tmp_path: Path) -> None:
    wrong = {
        "not made of keys": {"streams": json.dumps([{"key": "a//b"}])},
        "zenoh is off": {"zenoh_connect": ""},
    }
    for said, more in wrong.items():
        log = tmp_path / "log"
        with process(settings, "tcp/127.0.0.1:1", log, **more) as started:
            assert started.wait(60) == 1
        assert said in log.read_text()
        assert "Traceback" not in log.read_text(), log.read_text()


@pytest.mark.parametrize("mode", ["client", "peer"])
def test_a_service_without_its_router_ends_when_told(settings: Settings, tmp_path: Path, mode: str) -> None:
    with process(settings, "tcp/127.0.0.1:1", tmp_path / "log", zenoh_mode=mode) as started:
        until(lambda: "Uvicorn running" in (tmp_path / "log").read_text(), "it serves", 60)
        started.terminate()
        assert started.wait(20) == 0
    assert "Traceback" not in (tmp_path / "log").read_text()
