"""A request in the words of an earlier one is answered, refused and counted as that one was."""

from __future__ import annotations

import gzip
import time

import httpx
import pytest

from service.application import Application
from service.clouds import write_ply
from service.engine.cloud import PointCloud
from service.keys import KeyStore
from service.settings import Settings
from service.transports.rest import known
from service.transports.rest.app import create_app
from service.transports.rest.examples import CLOUD_XYZ
from tests.service.measured import samples
from tests.service.transports.zenoh.waiting import until

PATH = "/v1/responses"


def body_of(response: httpx.Response) -> dict:
    """An answer without what differs from one to the next."""
    return {name: value for name, value in response.json().items() if name not in ("timings_ms", "instance")}


@pytest.mark.parametrize(
    "query",
    ["", "?model=tiny", "?top=2&detail=concepts", "?detail=concepts,stimuli&time=0.5", "?segments=true", "?scene=true"],
)
def test_the_second_answer_is_the_first(client: httpx.Client, clouds: list[PointCloud], query: str) -> None:
    for cloud in clouds[:2]:
        first, second, third = (client.post(PATH + query, content=write_ply(cloud)) for _ in range(3))
        assert body_of(first) == body_of(second) == body_of(third)
        assert first.status_code == second.status_code
        assert first.headers.keys() == second.headers.keys()


@pytest.mark.parametrize("query", ["?top=0", "?tops=3", "?time=7", "?model=tiny:1&version=2", "?detail=all"])
def test_what_was_refused_is_refused_again(client: httpx.Client, clouds: list[PointCloud], query: str) -> None:
    ply = write_ply(clouds[0])
    assert client.post(PATH, content=ply).status_code == 200
    first, second = (client.post(PATH + query, content=ply) for _ in range(2))
    assert first.status_code == second.status_code == 422
    assert body_of(first) == body_of(second)


def test_a_body_is_judged_each_time(client: httpx.Client, clouds: list[PointCloud]) -> None:
    ply = write_ply(clouds[0])
    assert client.post(PATH, content=ply).status_code == 200
    for content, headers, status in (
        (b"nonsense", {}, 415),
        (b"", {}, 422),
        (ply, {"Content-Type": "text/html"}, 415),
        (ply, {"Content-Encoding": "gzip"}, 400),
        (gzip.compress(ply), {"Content-Encoding": "gzip"}, 200),
    ):
        response = client.post(PATH, content=content, headers=headers)
        assert response.status_code == status, response.text
        assert response.headers["X-Request-ID"]
        if status != 200:
            assert response.headers["Content-Type"] == "application/problem+json"
    form = client.post(PATH, files={"cloud": ("object.ply", ply)})
    assert form.status_code == 200, form.text


def test_other_methods_and_paths_are_none_of_it(client: httpx.Client, clouds: list[PointCloud]) -> None:
    assert client.post(PATH, content=write_ply(clouds[0])).status_code == 200
    assert client.get(PATH).status_code == 405
    assert client.post(f"{PATH}/nothing", content=b"x").status_code == 404


def test_all_are_counted_as_one_operation(
    client: httpx.Client, application: Application, clouds: list[PointCloud]
) -> None:
    for _ in range(4):
        assert client.post(PATH, content=write_ply(clouds[0])).status_code == 200
    counted = "shape_concepts_requests_total", ("operation", f"POST {PATH}"), ("outcome", "ok"), ("wire", "rest")
    until(lambda: samples(application.telemetry).get(counted) == 4, "four requests are counted")


def test_keys_are_asked_for_each_time(guarded: httpx.Client, settings: Settings) -> None:
    keys = KeyStore(settings.store)
    answering, training = keys.create("a", ("answer",)), keys.create("b", ("train",))
    time.sleep(1.1)  # the service believes what it read for a second

    def status(text: str | None) -> int:
        headers = {} if text is None else {"Authorization": f"Bearer {text}"}
        return guarded.post(PATH, content=CLOUD_XYZ, headers=headers).status_code

    assert [status(answering.text) for _ in range(3)] == [200] * 3
    assert [status(text) for text in (None, "sc_wrong", training.text)] == [401, 401, 403]
    keys.revoke(answering.key.id)
    time.sleep(1.1)
    assert status(answering.text) == 401


def test_who_asks_in_ever_new_words_fills_nothing(application: Application) -> None:
    table = create_app(application).state.known
    meant = known._Meant(known.remembered, {}, "answer", table)
    for number in range(3 * known.KEPT):
        query = f"time={number}".encode()
        table.remember({"method": "POST", "path": PATH, "query_string": query}, meant)
    table.remember({"method": "POST", "path": PATH, "query_string": b"x" * (known.LONGEST + 1)}, meant)
    assert len(table._meant) <= known.KEPT
    assert all(len(query) <= known.LONGEST for _, _, query in table._meant)
