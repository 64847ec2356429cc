"""A client that hangs up, with a real socket, before it has its answer."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any
from urllib.parse import urlsplit

import httpx
import numpy as np
import pytest

from service.answer import Answer
from service.application import Application
from service.clouds import write_ply
from service.engine.cloud import PointCloud
from service.scene_answer import SceneAnswer
from service.settings import Settings
from tests.service.measured import parsed
from tests.service.tabletop.seen import set_table
from tests.service.transports.open_inference.conftest import answering, request_of

HELD_AT = "segments"  # a stage in the middle of an answer


class Held(Application):
    """An application whose answers wait within a stage until they are let go."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings)
        self.go = threading.Event()
        self.held = threading.Semaphore(0)  # how many got as far as that
        self.begun: list[str] = []  # stages

    def respond(self, cloud: Any, **given: Any) -> Answer:
        return super().respond(cloud, **given | {"on_stage": self._hold(given["on_stage"])})

    def respond_scene(self, scene: Any, **given: Any) -> SceneAnswer:
        return super().respond_scene(scene, **given | {"on_stage": self._hold(given["on_stage"])})

    def _hold(self, on_stage: Callable[[str], None]) -> Callable[[str], None]:
        def held(stage: str) -> None:
            self.begun.append(stage)
            if stage == HELD_AT:
                self.held.release()
                while not self.go.wait(0.01):
                    on_stage(stage)
            on_stage(stage)

        return held


@pytest.fixture
def held(settings: Settings) -> Iterator[Held]:
    """Two work at a time, and two wait."""
    application = Held(settings)
    yield application
    application.go.set()
    application.close()


@pytest.fixture
def client(held: Held) -> Iterator[httpx.Client]:
    with answering(held) as client:
        yield client
        held.go.set()


def send(client: httpx.Client, request: httpx.Request) -> socket.socket:
    """A request on a socket of its own; nothing of the answer is read."""
    where = urlsplit(str(client.base_url))
    wire = socket.create_connection((where.hostname or "", where.port or 80))
    head = f"POST {request.url.raw_path.decode()} HTTP/1.1\r\n"
    head += "".join(f"{name}: {value}\r\n" for name, value in request.headers.items())
    wire.sendall(head.encode() + b"\r\n" + request.read())
    return wire


def until(true: Callable[[], bool]) -> None:
    end = time.monotonic() + 10
    while not true():
        assert time.monotonic() < end
        time.sleep(0.01)


def ended(client: httpx.Client, outcome: str) -> int:
    """How many requests for answers ended so, by the metrics."""
    return round(
        sum(
            value
            for (name, *labels), value in parsed(client.get("/metrics").text).items()
            if name == "shape_concepts_requests_total"
            and dict(labels)["outcome"] == outcome  # type: ignore[call-overload]
            and dict(labels)["operation"] != "GET /metrics"  # type: ignore[call-overload]
        )
    )


def asks(client: httpx.Client, cloud: PointCloud) -> dict[str, httpx.Request]:
    """Requests for an answer, by what they are."""
    ply, thin = write_ply(cloud), request_of(cloud.points[::8])
    return {
        "a body": client.build_request("POST", "/v1/responses", content=ply),
        "a form": client.build_request("POST", "/v1/responses", files={"cloud": ply}),
        "a scene": client.build_request(
            "POST", "/v1/responses", params={"scene": True}, content=write_ply(set_table().cloud)
        ),
        "a tensor": client.build_request("POST", "/v2/models/tiny/infer", content=json.dumps(thin).encode()),
    }


@pytest.mark.parametrize("kind", ["a body", "a form", "a scene", "a tensor"])
def test_work_ends_when_its_client_hangs_up(
    client: httpx.Client, held: Held, clouds: list[PointCloud], kind: str
) -> None:
    wire = send(client, asks(client, clouds[0])[kind])
    assert held.held.acquire(timeout=20)
    assert ended(client, "cancelled") == 0
    wire.close()
    until(lambda: ended(client, "cancelled") == 1)
    assert held.begun[-1] == HELD_AT
    assert held.pool.at_work == held.pool.waiting == held.intake.held == 0
    page = client.get("/metrics").text
    assert f'stage="{HELD_AT}"' not in page
    assert ended(client, "ok") == 0


def test_a_request_that_waits_gives_its_place_back_at_once(
    client: httpx.Client, held: Held, clouds: list[PointCloud]
) -> None:
    one = asks(client, clouds[0])["a body"]
    working = [send(client, one) for _ in range(2)]
    for _ in working:
        assert held.held.acquire(timeout=20)
    waiting = [send(client, one) for _ in range(2)]
    until(lambda: held.pool.waiting == 2)
    assert client.post("/v1/responses", content=write_ply(clouds[0])).status_code == 429
    for wire in waiting:
        wire.close()
    until(lambda: ended(client, "cancelled") == 2)
    assert (held.pool.at_work, held.pool.waiting) == (2, 0)
    begun = len(held.begun)
    held.go.set()
    for wire in working:
        assert wire.recv(1000).startswith(b"HTTP/1.1 200")
        wire.close()
    assert client.post("/v1/responses", content=write_ply(clouds[0])).status_code == 200
    assert held.begun[begun:].count("decode") == 1
    until(lambda: ended(client, "ok") == 3)


def test_who_stays_gets_its_answer_whoever_hangs_up_beside_it(
    client: httpx.Client, held: Held, clouds: list[PointCloud]
) -> None:
    held.go.set()
    expected = client.post("/v1/responses", content=write_ply(clouds[0])).json()
    rng = np.random.default_rng(0)
    for pause in rng.uniform(0, 0.1, 8):
        wire = send(client, asks(client, clouds[0])["a body"])
        time.sleep(pause)
        wire.close()
        answer = client.post("/v1/responses", content=write_ply(clouds[0]))
        if answer.status_code == 200:
            assert answer.json()["responses"] == expected["responses"]
        else:
            assert answer.status_code == 429
    until(lambda: held.pool.at_work == held.pool.waiting == held.intake.held == 0)
    assert ended(client, "internal") == 0
