"""POST /v1/responses/batch: an answer or a problem for each cloud, in order, and a fair share of the pool."""

from __future__ import annotations

import gzip
import json
import logging
import socket
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import httpx
import pytest

from service.answer import Answer
from service.application import Application
from service.clouds import write_ply
from service.engine.cloud import PointCloud
from service.settings import Settings
from tests.service.transports.rest.test_responses import answer_of, as_xyz
from tests.service.transports.zenoh.waiting import until

BATCH = "/v1/responses/batch"


@pytest.fixture
def settings(settings: Settings) -> Settings:
    return settings.model_copy(update={"max_body": 2**23})


def files(*contents: bytes) -> list[tuple[str, tuple[str, bytes]]]:
    return [("cloud", (f"{number}.bin", content)) for number, content in enumerate(contents)]


def items_of(response: httpx.Response) -> list[dict[str, Any]]:
    assert response.status_code == 200, response.text
    for item in response.json()["items"]:
        assert len({"answer", "problem"} & set(item)) == 1
    return list(response.json()["items"])


def test_each_item_is_what_the_cloud_alone_is_answered(client: httpx.Client, clouds: list[PointCloud]) -> None:
    contents = [write_ply(clouds[0]), b"ply\n", as_xyz(clouds[1]), b"", b"\x00\x01", write_ply(clouds[2])]
    for params in ({}, {"detail": "stimuli,responses"}, {"detail": "concepts", "top": 2, "time": 0.5}):
        items = items_of(client.post(BATCH, files=files(*contents), params=params))
        assert [item["file"] for item in items] == [f"{number}.bin" for number in range(6)]
        for number, (item, content) in enumerate(zip(items, contents, strict=True)):
            alone = client.post("/v1/responses", files={"cloud": (f"{number}.bin", content)}, params=params)
            if alone.status_code == 200:
                assert {key: item["answer"][key] for key in answer_of(alone)} == answer_of(alone)
                assert set(item["answer"]) == set(alone.json())
            else:
                assert {**item["problem"], "instance": ""} == {**alone.json(), "instance": ""}


def test_clouds_may_come_as_a_json_list(client: httpx.Client, clouds: list[PointCloud]) -> None:
    points = [cloud.points.tolist() for cloud in clouds[:3]]
    listed = [points[0], {"points": points[1], "unit": "m"}, [[0, 0]], points[2], None]
    items = items_of(client.post(BATCH, json=listed))
    assert ["answer" in item for item in items] == [True, True, False, True, False]
    for item, place in ((items[0], 0), (items[1], 1), (items[3], 2)):
        alone = answer_of(client.post("/v1/responses", json=points[place]))
        assert {key: item["answer"][key] for key in alone} == alone


@pytest.mark.parametrize(
    ("status", "kind", "request_"),
    [
        (404, "model-not-found", {"files": files(b"1"), "params": {"model": "nobody"}}),
        (422, "invalid-parameter", {"files": files(b"1"), "params": {"detail": "everything"}}),
        (422, "invalid-parameter", {"files": files(b"1"), "params": {"explain": True}}),
        (422, "invalid-parameter", {"files": files(b"1"), "params": {"unit": "furlong"}}),
        (422, "invalid-parameter", {"files": files(b"1"), "params": {"viewpoint": ""}}),
        (413, "content-too-large", {"files": files(*[b"1"] * 65)}),
        (413, "content-too-large", {"json": [[]] * 65}),
        (413, "content-too-large", {"files": files(bytes(2**23), b"1")}),
        (400, "unreadable-cloud", {"files": {"scan": b"1"}}),
        (400, "unreadable-cloud", {"json": []}),
        (400, "unreadable-cloud", {"json": {}}),
        (400, "unreadable-cloud", {"content": b"[[[1,2,3]]", "headers": {"content-type": "application/json"}}),
        (415, "unsupported-format", {"content": b"1 2 3"}),
    ],
)
def test_what_is_no_batch_is_refused(client: httpx.Client, status: int, kind: str, request_: dict[str, Any]) -> None:
    refused = client.post(BATCH, **request_)
    assert (refused.status_code, refused.json()["type"]) == (status, f"urn:shape-concepts:error:{kind}"), refused.text


def test_problems_name_the_request(client: httpx.Client) -> None:
    response = client.post(BATCH, files=files(b"", b""), headers={"x-request-id": "robot-7"})
    assert {item["problem"]["instance"] for item in items_of(response)} == {"urn:shape-concepts:request:robot-7"}


def test_a_batch_that_finds_all_places_taken_is_refused_at_once(client: httpx.Client, application: Application) -> None:
    places = [application.pool.admitted() for _ in range(application.pool.places)]
    for place in places:
        place.__enter__()
    refused = client.post(BATCH, files=files(b"1"))
    assert (refused.status_code, "retry-after" in refused.headers) == (429, True)
    for place in places:
        place.__exit__(None, None, None)
    assert json.loads(client.post(BATCH, files=files(b"1")).text)["items"]


class Held(Application):
    """An application that waits within every answer until it is told to go on."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings)
        self.begun, self.go = threading.Event(), threading.Event()
        self.asked: list[bytes] = []  # clouds, in the order in which they were worked on

    def respond(self, cloud: Any, **given: Any) -> Answer:
        self.asked.append(cloud.data)
        self.begun.set()
        assert self.go.wait(20)
        return super().respond(cloud, **given)


@pytest.fixture
def held(settings: Settings) -> Iterator[Held]:
    application = Held(settings)
    yield application
    application.go.set()
    application.close()


class TestWithOneWorker:
    @pytest.fixture
    def settings(self, settings: Settings) -> Settings:
        return settings.model_copy(update={"workers": 1, "queue": 1})

    @pytest.fixture
    def application(self, held: Held) -> Held:
        return held

    def test_another_request_waits_for_one_cloud_of_a_batch_only(
        self, client: httpx.Client, held: Held, clouds: list[PointCloud]
    ) -> None:
        ply, other = write_ply(clouds[0]), write_ply(clouds[1])
        with ThreadPoolExecutor(2) as threads:
            batch = threads.submit(client.post, BATCH, files=files(*[ply] * 10))
            assert held.begun.wait(20)
            one = threads.submit(client.post, "/v1/responses", content=other)
            until(lambda: held.pool.waiting == 1, "the other request waits")
            held.go.set()
            answer_of(one.result())
            assert len(items_of(batch.result())) == 10
        assert held.asked.index(other) == 1


class TestWhenAClientHangsUp:
    @pytest.fixture
    def application(self, held: Held) -> Held:
        return held

    @pytest.mark.parametrize("coding", [b"identity", b"gzip"])
    def test_its_batch_is_not_finished(
        self,
        client: httpx.Client,
        held: Held,
        clouds: list[PointCloud],
        caplog: pytest.LogCaptureFixture,
        coding: bytes,
    ) -> None:
        form = httpx.Request("POST", "http://x", files=files(*[write_ply(clouds[0])] * 64))
        body = gzip.compress(form.read(), 1) if coding == b"gzip" else form.read()
        head = b"POST /v1/responses/batch HTTP/1.1\r\nHost: x\r\nContent-Type: %s\r\n" % (
            form.headers["content-type"].encode()
        )
        head += b"Content-Encoding: %s\r\nContent-Length: %d\r\n\r\n" % (coding, len(body))
        with caplog.at_level(logging.INFO):
            with socket.create_connection((client.base_url.host, client.base_url.port or 80)) as wire:
                wire.sendall(head + body)
                assert held.begun.wait(20)
            held.go.set()
            began = time.monotonic()
            while "hung up when" not in caplog.text:
                assert time.monotonic() - began < 10
                time.sleep(0.01)
