"""Streams watched over HTTP while robots publish them through a real router."""

from __future__ import annotations

import base64
import itertools
import json
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from typing import Any

import httpx
import numpy as np
import pytest
import zenoh

from service.application import Application
from service.clouds import SceneCloud, write_ply
from service.engine.cloud import PointCloud
from service.keys import KeyStore
from service.live import POINTS, WATCHERS
from service.settings import Settings
from tests.service.conftest import asked_over_http
from tests.service.tabletop.seen import set_table
from tests.service.transports.zenoh.conftest import Served, put
from tests.service.transports.zenoh.router import free_endpoint
from tests.service.transports.zenoh.test_answering import hearing, numbered
from tests.service.transports.zenoh.waiting import until

KEY = "robots/7/cloud"
STREAM = {"key": "robots/*/cloud"}


@contextmanager
def watching(client: httpx.Client, **asked: Any) -> Iterator[Iterator[dict[str, Any]]]:
    """The clouds that a client is told of, from now on."""
    with client.stream("GET", "/v1/streams/events", params=asked) as response:
        assert response.status_code == 200, response.read()
        assert response.headers["Content-Type"].startswith("text/event-stream")
        lines = response.iter_lines()
        assert next(lines).startswith("retry: ")  # sent once somebody watches
        yield (json.loads(line.removeprefix("data: ")) for line in lines if line.startswith("data: "))


def drawn(cloud: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Points (M, 3) and the part of each (M,)."""
    xyz, parts = (base64.b64decode(cloud[name], validate=True) for name in ("xyz", "parts"))
    return np.frombuffer(xyz, "<f4").reshape(-1, 3), np.frombuffer(parts, "<i2")


def test_a_cloud_is_shown_with_its_answer_and_the_segment_of_each_point(
    served: Served, robot: zenoh.Session, clouds: list[PointCloud]
) -> None:
    application = served(streams=[STREAM | {"top": 3}])
    expected = application.respond(clouds[0], top=3, segments=True)
    with (
        asked_over_http(application) as client,
        hearing(robot, "robots/*/cloud/concepts") as heard,
        watching(client) as coming,
    ):
        put(robot, KEY, write_ply(clouds[0]), attachment=numbered(42, time.time_ns()))
        told = next(coming)
        until(lambda: heard, "the answer on the stream")
    assert (told["stream"], told["key"], told["problem"], told["skipped"]) == ("robots/*/cloud", KEY, None, 0)
    assert told["answer"] == heard[0].document
    assert told["answer"]["source"]["sequence"] == 42
    assert 0 < told["latency_s"] < 60
    assert abs(told["at"] - time.time()) < 60
    xyz, parts = drawn(told["cloud"])
    assert (told["cloud"]["kind"], told["cloud"]["measured"]) == ("segments", len(clouds[0].points))
    assert told["cloud"]["points"] == len(xyz) == len(parts) == min(len(clouds[0].points), POINTS)
    of_point = {tuple(p): s for p, s in zip(clouds[0].points.tolist(), expected.point_segments or [], strict=True)}
    assert [of_point[tuple(point)] for point in xyz.tolist()] == parts.tolist()
    assert len(set(parts.tolist())) > 1


def test_what_is_published_is_the_same_whether_somebody_watches_or_not(
    served: Served, robot: zenoh.Session, clouds: list[PointCloud]
) -> None:
    scene = write_ply(set_table("kinect").cloud)
    application = served(streams=[STREAM, {"key": "tables/*", "scene": True}])
    with asked_over_http(application) as client, hearing(robot, "**/concepts") as heard:
        for key, sent in ((KEY, write_ply(clouds[0])), ("tables/1", scene)):
            put(robot, key, sent)
            until(lambda: len(heard) in (1, 3), "an answer to nobody in particular")
            with watching(client, points=5) as coming:
                put(robot, key, sent)
                shown = next(coming)
            until(lambda: len(heard) in (2, 4), "an answer while somebody watches")
            assert shown["answer"] == heard[-1].document
            assert "point_" not in str(heard[-2:])
    for before, after in (heard[:2], heard[2:]):
        assert before.document.keys() == after.document.keys()
        assert before.document.get("concepts") == after.document.get("concepts")


def test_a_scene_is_shown_with_the_object_of_each_point(served: Served, robot: zenoh.Session) -> None:
    application = served(streams=[STREAM | {"scene": True}])
    table = set_table("kinect").cloud
    expected = application.respond_scene(SceneCloud(table), segments=True)
    with asked_over_http(application) as client, watching(client) as coming:
        put(robot, KEY, write_ply(table))
        told = next(coming)
    xyz, parts = drawn(told["cloud"])
    assert told["cloud"]["kind"] == "objects"
    of_point = {tuple(p): s for p, s in zip(table.points.tolist(), expected.point_objects or [], strict=True)}
    assert [of_point[tuple(point)] for point in xyz.tolist()] == parts.tolist()
    assert set(parts.tolist()) == {-1, *range(len(expected.objects))}


def test_a_cloud_that_cannot_be_answered_is_shown_with_the_reason(served: Served, robot: zenoh.Session) -> None:
    application = served(streams=[STREAM])
    with asked_over_http(application) as client, watching(client) as coming:
        put(robot, KEY, b"no cloud")
        unreadable = next(coming)
        put(robot, KEY, b"0 0 1\n0 0.1 1\n")
        too_few = next(coming)
    assert (unreadable["answer"], unreadable["cloud"]) == (None, None)
    assert too_few["problem"]["type"].endswith("too-few-points")
    assert too_few["cloud"]["measured"] == 2


def test_points_are_sent_as_many_as_are_asked_for_and_of_the_key_that_is_looked_at(
    served: Served, robot: zenoh.Session, clouds: list[PointCloud]
) -> None:
    application = served(streams=[STREAM])
    with asked_over_http(application) as client, watching(client, points=100, key=KEY) as coming:
        for key in ("robots/8/cloud", KEY):
            put(robot, key, write_ply(clouds[0]))
        told = {one["key"]: one for one in (next(coming), next(coming))}
    assert told["robots/8/cloud"]["cloud"] is None
    assert told["robots/8/cloud"]["answer"]["concepts"]
    assert told[KEY]["cloud"]["points"] == 100


def test_who_leaves_watches_no_longer_and_nobody_works_for_them(
    served: Served, robot: zenoh.Session, clouds: list[PointCloud]
) -> None:
    application = served(streams=[STREAM])
    stream = application.live.streams[0]
    with asked_over_http(application) as client:
        with watching(client):
            assert application.live.watched(stream)
        until(lambda: not application.live.watched(stream), "the watcher has left")


def test_too_many_watchers_are_refused_and_all_are_let_go_when_the_service_ends(
    served: Served, robot: zenoh.Session
) -> None:
    application = served(streams=[STREAM])
    with asked_over_http(application) as client, watching(client) as coming:
        with ExitStack() as others:
            for _ in range(WATCHERS - 1):
                others.enter_context(watching(client))
            refused = client.get("/v1/streams/events")
            assert (refused.status_code, refused.headers["Retry-After"]) == (429, "1")
        application.let_go()
        assert list(coming) == []


def test_streams_are_listed_and_others_are_not_found(served: Served) -> None:
    application = served(streams=[STREAM | {"model": "tiny", "scene": True}])
    with asked_over_http(application) as client:
        assert client.get("/v1/streams").json() == {
            "connected": True,
            "streams": [STREAM | {"publish_to": "{key}/concepts", "model": "tiny", "scene": True, "share": "key"}],
        }
        unknown = client.get("/v1/streams/events", params={"stream": "arms/*"})
        assert (unknown.status_code, unknown.json()["type"].rpartition(":")[2]) == (404, "stream-not-found")
        assert "robots/*/cloud" in unknown.json()["detail"]
        assert client.get("/v1/streams/events", params={"points": POINTS + 1}).status_code == 422


def test_without_zenoh_there_is_nothing_to_watch_and_it_is_said_why(client: httpx.Client) -> None:
    assert client.get("/v1/streams").json() == {"connected": False, "streams": []}
    refused = client.get("/v1/streams/events")
    assert (refused.status_code, refused.json()["type"].rpartition(":")[2]) == (404, "stream-not-found")
    assert "SHAPE_CONCEPTS_STREAMS" in refused.json()["detail"]


class TestBeforeTheRouterIsThere:
    @pytest.fixture
    def settings(self, settings: Settings) -> Settings:
        given = settings.model_dump() | {"streams": [STREAM], "zenoh_connect": [free_endpoint()]}
        return Settings(**given)

    def test_whoever_watches_is_told_to_come_back(self, client: httpx.Client) -> None:
        assert client.get("/v1/streams").json()["connected"] is False
        refused = client.get("/v1/streams/events")
        assert (refused.status_code, refused.json()["type"].rpartition(":")[2]) == (503, "streams-unavailable")
        assert refused.headers["Retry-After"] == "1"


@pytest.mark.parametrize(("scope", "status"), [("answer", 404), ("train", 403), ("manage", 403)])
def test_only_who_may_have_answers_may_watch(settings: Settings, scope: Any, status: int) -> None:
    application = Application(settings.model_copy(update={"access": "keys"}))
    text = KeyStore(settings.store).create("a", (scope,)).text
    with asked_over_http(application) as client:
        assert client.get("/v1/streams/events").status_code == 401
        watched = client.get("/v1/streams/events", headers={"Authorization": f"Bearer {text}"})
        assert watched.status_code == status
    application.close()


def test_whichever_replica_is_watched_shows_what_all_of_them_answer(
    served: Served, robot: zenoh.Session, clouds: list[PointCloud]
) -> None:
    watched, _ = (served(streams=[STREAM]) for _ in range(2))
    keys = {f"robots/{number}/cloud" for number in range(8)}  # one replica has them all once in 128 times
    told: list[dict[str, Any]] = []
    numbers = itertools.count()

    def all_shown() -> bool:  # once the other replica knows that it is watched
        number = next(numbers)
        for key in keys:
            put(robot, key, write_ply(clouds[0]), attachment=numbered(number))
        time.sleep(0.2)
        return {one["key"] for one in told} == keys

    with asked_over_http(watched) as client, watching(client) as coming, ThreadPoolExecutor(1) as thread:
        reading = thread.submit(lambda: [told.append(one) for one in coming])  # type: ignore[func-returns-value]
        until(all_shown, "clouds of both replicas")
        watched.let_go()
        reading.result()
    names = [(one["key"], one["answer"]["source"]["sequence"]) for one in told]
    assert len(set(names)) == len(names)  # nothing is shown twice
    assert len({(one["cloud"]["xyz"], one["cloud"]["parts"], one["cloud"]["measured"]) for one in told}) == 1
    assert len({str(one["answer"]["responses"]) for one in told}) == 1
