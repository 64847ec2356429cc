"""Several replicas over one store: one is killed, an alias moves, and every request has one whole answer."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import httpx
import pytest

from service.clouds import write_ply
from service.engine.params import ModelParams
from service.store import ModelStore
from tests.learnt import learnt, named_clouds, objects
from worker.learning.train import train

CLIENTS = 6
REQUESTS = 600
TAKEN_UP = 5.0  # seconds in which every replica takes up an alias that moved


class Answered(NamedTuple):
    """An answer, who gave it, and when it was asked for."""

    number: int
    replica: int
    asked: float
    document: dict[str, Any]


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> ModelStore:
    """A store with two versions that answer differently; the alias means the first."""
    store = ModelStore(tmp_path_factory.mktemp("store"))
    store.publish(learnt(), name="tiny", seed=5, source={"simulated": 14})
    store.publish(train(named_clouds()[:10], ModelParams()).model, name="tiny", seed=5, source={}, alias=None)
    return store


@contextmanager
def replica(store: ModelStore, log: Path) -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "service.cli", "serve", "--port", str(port), "--grpc-port", "-1"]
    environment = os.environ | {"SHAPE_CONCEPTS_STORE": store.url, "SHAPE_CONCEPTS_WORKERS": "1"}
    with log.open("wb") as stderr:
        process = subprocess.Popen(command, stderr=stderr, env=environment)
    try:
        address = f"http://127.0.0.1:{port}"
        for _ in range(600):
            try:
                if httpx.get(f"{address}/readyz").status_code == 200:
                    break
            except httpx.TransportError:
                assert process.poll() is None, log.read_text()
            time.sleep(0.1)
        yield process, address
    finally:
        process.kill()
        process.wait()


@pytest.mark.slow
def test_a_replica_killed_and_an_alias_moved_under_load_lose_no_answer_and_mix_none(
    store: ModelStore, tmp_path: Path
) -> None:
    clouds = [write_ply(thing.cloud) for thing in objects()[:4]]
    with replica(store, tmp_path / "a") as (doomed, first), replica(store, tmp_path / "b") as (_, second):
        expected = {
            version: [
                httpx.post(f"{second}/v1/responses", params={"version": version}, content=cloud).json()["responses"]
                for cloud in clouds
            ]
            for version in (1, 2)
        }
        alive, numbers, lock = [first, second], count(), threading.Lock()
        answered: list[Answered] = []
        failures: list[str] = []
        moved: list[float] = []

        def ask(client: httpx.Client) -> None:
            while (number := next(numbers)) < REQUESTS:
                for attempt in count():
                    with lock:
                        address = alive[(number + attempt) % len(alive)]
                    asked = time.monotonic()
                    try:
                        response = client.post(f"{address}/v1/responses", content=clouds[number % len(clouds)])
                    except httpx.TransportError:  # it was killed: ask another
                        continue
                    if response.status_code == 429:
                        time.sleep(0.05)
                        continue
                    if response.status_code != 200:
                        failures.append(response.text)
                        break
                    answered.append(Answered(number, [first, second].index(address), asked, response.json()))
                    break
                if number == REQUESTS // 3:
                    store.promote("tiny", 2)
                    moved.append(time.monotonic())
                if number == REQUESTS // 2:
                    doomed.send_signal(signal.SIGKILL)
                    with lock:
                        alive.remove(first)

        with ThreadPoolExecutor(CLIENTS) as pool, httpx.Client(timeout=60) as client:
            for work in [pool.submit(ask, client) for _ in range(CLIENTS)]:
                work.result()
        time.sleep(max(0.0, moved[0] + TAKEN_UP - time.monotonic()))
        assert httpx.post(f"{second}/v1/responses", content=clouds[0]).json()["version"] == 2

    assert failures == []
    assert sorted(each.number for each in answered) == list(range(REQUESTS))
    assert {each.replica for each in answered} == {0, 1}
    for each in answered:
        version = each.document["version"]
        assert each.document["responses"] == expected[version][each.number % len(clouds)]
    late = [each.document["version"] for each in answered if each.asked > moved[0] + TAKEN_UP]
    assert {each.document["version"] for each in answered} == {1, 2}
    assert set(late) <= {2}
    assert all(each.document["version"] == 1 for each in answered if each.number < REQUESTS // 3 - CLIENTS)
