"""Clouds asked about over zenoh, through a real router."""

from __future__ import annotations

import contextlib
import json
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import httpx
import numpy as np
import pytest
import zenoh
from zenoh.ext import z_serialize

from service.application import Application
from service.clouds import write_ply
from service.engine.cloud import PointCloud
from service.keys import KeyStore
from service.settings import Settings
from tests.service.clouds.written import npy, pointcloud2
from tests.service.tabletop.seen import set_table
from tests.service.transports.rest.test_responses import REFUSED, answer_of, as_xyz
from tests.service.transports.zenoh.conftest import Served, replicas, running
from tests.service.transports.zenoh.waiting import until

Asked = tuple[bool, str, dict[str, Any]]


def ask(robot: zenoh.Session, selector: str, payload: bytes | None = None, **more: Any) -> Asked:
    """Whether it was answered, the encoding, and the document; there has to be one reply."""
    (reply,) = replies(robot, selector, payload, **more)
    return reply


def replies(robot: zenoh.Session, selector: str, payload: bytes | None = None, **more: Any) -> list[Asked]:
    found = robot.get(f"shape-concepts/@v1/models/{selector}", payload=payload, timeout=20, **more)
    results = [(reply.ok is not None, reply.result) for reply in found]
    return [(good, str(result.encoding), json.loads(result.payload.to_bytes())) for good, result in results]


@pytest.fixture
def replica(served: Served) -> Application:
    return served(max_body=2**20)


def test_the_answer_over_zenoh_is_that_over_http(
    replica: Application, client: httpx.Client, robot: zenoh.Session, clouds: list[PointCloud]
) -> None:
    for params in (
        {},
        {"time": 0.8, "top": 2},
        {"explain": "true", "segments": "true", "stimuli": "true", "unit": "dm"},
        {"detail": "concepts"},
        {"detail": "stimuli,explanation", "top": 1},
    ):
        for cloud in clouds[:3]:
            expected = answer_of(client.post("/v1/responses", params=params, content=write_ply(cloud)))
            selector = "tiny/respond?" + ";".join(f"{name}={value}" for name, value in params.items())
            good, encoding, answer = ask(robot, selector, write_ply(cloud), encoding="model/ply")
            assert (good, encoding) == (True, "application/json")
            assert answer.pop("timings_ms")
            assert answer == expected


def test_model_and_format_may_be_named_in_several_ways(
    replica: Application, robot: zenoh.Session, clouds: list[PointCloud]
) -> None:
    ply, xyz, cdr = write_ply(clouds[0]), as_xyz(clouds[0]), pointcloud2(clouds[0].points)
    asked = [
        ask(robot, "tiny/respond", ply),
        ask(robot, "tiny:1/respond", ply),
        ask(robot, "tiny@production/respond", ply),
        ask(robot, "tiny/respond?version=1", ply, encoding="application/octet-stream"),
        ask(robot, "tiny/respond?alias=production", xyz, encoding="text/plain"),
        ask(robot, "tiny/respond?format=xyz;viewpoint=0,0,0", xyz, encoding="zenoh/string"),
        ask(robot, "tiny/respond?_time=now()", ply),
        ask(robot, "tiny/respond", cdr, encoding="application/cdr;sensor_msgs/msg/PointCloud2"),
        ask(robot, "tiny/respond?format=pointcloud2", cdr),
    ]
    for good, _, answer in asked:
        assert good, answer
        assert answer["version"] == 1
        assert {**answer, "timings_ms": 0} == {**asked[0][2], "timings_ms": 0}


def test_a_depth_image_is_answered_as_over_http(
    replica: Application, client: httpx.Client, robot: zenoh.Session
) -> None:
    rows, columns = np.indices((120, 160))
    depth = (600 + 100 * np.hypot(rows - 60, columns - 80) / 80).astype(np.uint16)
    params = {"intrinsics": "400,400,79.5,59.5", "depth_scale": 0.0012}
    expected = answer_of(client.post("/v1/responses", params=params, content=npy(depth)))
    selector = "tiny/respond?" + ";".join(f"{name}={value}" for name, value in params.items())
    good, _, answer = ask(robot, selector, npy(depth))
    assert good, answer
    assert {**answer, "timings_ms": 0} == {**expected, "timings_ms": 0}


def dented_ball() -> tuple[bytes, bytes, dict[str, Any]]:
    """A depth image of a ball before a wall, a mask that cuts it out, and what is said of the camera."""
    rows, columns = np.indices((120, 160))
    within = np.hypot(rows - 60, columns - 80) < 50
    depth = np.where(within, 600 + 100 * np.hypot(rows - 60, columns - 80) / 80, 900).astype(np.uint16)
    return npy(depth), npy(within.astype(np.uint8)), {"intrinsics": "400,400,79.5,59.5"}


def test_a_mask_comes_as_the_attachment_and_cuts_out_as_over_http(
    served: Served, client: httpx.Client, robot: zenoh.Session
) -> None:
    image, mask, params = dented_ball()
    files = {"cloud": ("depth.npy", image), "mask": ("mask.npy", mask)}
    expected = answer_of(client.post("/v1/responses", params=params, files=files))
    selector = f"tiny/respond?intrinsics={params['intrinsics']}"
    served(max_body=2**20)
    good, _, answer = ask(robot, selector, image, attachment=z_serialize({"mask": mask}))
    assert good, answer
    assert {**answer, "timings_ms": 0} == {**expected, "timings_ms": 0}
    assert ask(robot, selector, image)[2]["extent_m"] > 1.1 * answer["extent_m"]
    for attachment, kind in (
        (z_serialize({"mask": mask}).to_bytes()[:-20], "invalid-parameter"),
        (z_serialize({"mask": mask, "msak": mask}), "invalid-parameter"),
        (mask, "invalid-parameter"),
        (z_serialize({"mask": b"\x89PNG"}), "unreadable-cloud"),
        (z_serialize({"mask": b""}), "unreadable-cloud"),
        (z_serialize({"mask": npy(np.ones((120, 161), np.uint8))}), "unreadable-cloud"),
        (z_serialize({"mask": npy(np.zeros((120, 160), np.uint8))}), "no-finite-points"),
        (z_serialize({"mask": npy(np.ones((1000, 1100), np.uint8))}), "content-too-large"),
    ):
        good, _, problem = ask(robot, selector, image, attachment=attachment)
        assert (good, problem["type"]) == (False, f"urn:shape-concepts:error:{kind}"), problem
    good, _, problem = ask(robot, "tiny/respond", b"1 2 3\n", attachment=z_serialize({"mask": mask}))
    assert (good, problem["type"]) == (False, "urn:shape-concepts:error:invalid-parameter")


def test_a_mask_may_come_with_an_access_key(
    served: Served, client: httpx.Client, robot: zenoh.Session, settings: Settings
) -> None:
    image, mask, params = dented_ball()
    key = KeyStore(settings.store).create("a", ("answer",)).text.encode()
    files = {"cloud": ("depth.npy", image), "mask": ("mask.npy", mask)}
    expected = answer_of(client.post("/v1/responses", params=params, files=files))
    served(access="keys")
    selector = f"tiny/respond?intrinsics={params['intrinsics']}"
    good, _, answer = ask(robot, selector, image, attachment=z_serialize({"mask": mask, "key": key}))
    assert good, answer
    assert {**answer, "timings_ms": 0} == {**expected, "timings_ms": 0}
    for fields in ({"mask": mask}, {"mask": mask, "key": b"sc_wrong"}, {"mask": mask, "key": key, "x": b""}):
        good, _, problem = ask(robot, selector, image, attachment=z_serialize(fields))
        assert (good, problem["type"]) == (False, "urn:shape-concepts:error:not-authenticated")


def test_queries_are_measured_by_their_outcomes(
    replica: Application, robot: zenoh.Session, clouds: list[PointCloud]
) -> None:
    ask(robot, "tiny/respond", write_ply(clouds[0]))
    ask(robot, "tiny/respond", b"1 2 3\n")
    for outcome in ("ok", "too-few-points"):
        counted = f'requests_total{{operation="respond",outcome="{outcome}",wire="zenoh"}} 1.0'
        until(lambda counted=counted: counted in replica.telemetry.metrics.page()[0].decode(), outcome)  # type: ignore[misc]


def test_a_scene_is_answered_as_over_http(replica: Application, client: httpx.Client, robot: zenoh.Session) -> None:
    data = write_ply(set_table("kinect").cloud)
    expected = answer_of(client.post("/v1/responses", params={"scene": True}, content=data))
    good, _, answer = ask(robot, "tiny/respond?scene=true", data)
    assert good, answer
    assert len(answer["objects"]) > 1
    for document in (answer, expected):
        document.pop("timings_ms", None)
        for found in document["objects"]:
            (found["answer"] or {}).pop("timings_ms", None)
    assert answer == expected


def as_query(request: dict[str, Any]) -> tuple[str, bytes, str] | None:
    """A request of the REST interface as a query; None for what there is in HTTP alone."""
    if "files" in request or "multipart" in str(request.get("headers")):
        return None
    params = dict(request.get("params", {}))
    model = params.pop("model", "tiny")
    if "/" in model:
        return None
    selector = f"{model}/respond?" + ";".join(f"{name}={value}" for name, value in params.items())
    content = json.dumps(request["json"]).encode() if "json" in request else request.get("content", b"")
    return selector, content, request.get("headers", {}).get("content-type", "zenoh/bytes")


QUERIES = [(name, status, kind, asked) for name, status, kind, sent in REFUSED if (asked := as_query(sent))]


def test_what_http_refuses_zenoh_refuses_with_the_same_problem(replica: Application, robot: zenoh.Session) -> None:
    assert len(QUERIES) > 20
    for name, status, kind, (selector, payload, encoding) in QUERIES:
        good, answered, problem = ask(robot, selector, payload, encoding=encoding)
        assert (good, answered) == (False, "application/problem+json"), name
        assert (problem["status"], problem["type"]) == (status, f"urn:shape-concepts:error:{kind}"), (name, problem)
        assert problem["instance"].startswith("urn:uuid:")
        assert len(problem["detail"]) > 10


@pytest.mark.parametrize(
    ("selector", "kind"),
    [
        ("tiny/respond", "empty-cloud"),  # no payload at all
        ("tiny/respond?top=1;top=2", "invalid-parameter"),
        ("tiny/respond?explain", "invalid-parameter"),
        ("tiny/respond?viewpoint=a,b,c", "invalid-parameter"),
        ("tiny/respond?format=stl", "unsupported-format"),
        ("*/respond", "invalid-parameter"),
        ("**", "invalid-parameter"),
        ("t$*/respond", "invalid-parameter"),
        ("Tiny Model/respond", "invalid-parameter"),
        (f"{'x' * 2000}/respond", "invalid-parameter"),
    ],
)
def test_a_query_that_is_none_is_told_so(replica: Application, robot: zenoh.Session, selector: str, kind: str) -> None:
    payload = None if kind == "empty-cloud" else b"1 2 3\n"
    good, _, problem = ask(robot, selector, payload)
    assert (good, problem["type"]) == (False, f"urn:shape-concepts:error:{kind}"), problem


def test_a_misspelt_parameter_is_told_those_that_exist(replica: Application, robot: zenoh.Session) -> None:
    _, _, problem = ask(robot, "tiny/respond?toop=1", b"1 2 3\n")
    for name in ("toop", "version", "alias", "time", "top", "unit", "viewpoint", "stimuli", "explain", "format"):
        assert name in problem["detail"]


def test_at_its_limit_a_replica_refuses_at_once_and_says_when_to_try_again(
    replica: Application, robot: zenoh.Session, clouds: list[PointCloud]
) -> None:
    places = [replica.pool.admitted() for _ in range(replica.pool.places)]
    for place in places:
        place.__enter__()
    good, _, problem = ask(robot, "tiny/respond", write_ply(clouds[0]))
    assert (good, problem["type"], problem["status"]) == (False, "urn:shape-concepts:error:overloaded", 429)
    assert problem["retry_after"] >= 1
    for place in places:
        place.__exit__(None, None, None)
    assert ask(robot, "tiny/respond", write_ply(clouds[0]))[0]


def test_a_fault_of_ours_is_told_without_its_inside(served: Served, robot: zenoh.Session) -> None:
    served().close()  # its threads are gone
    good, _, problem = ask(robot, "tiny/respond", b"1 2 3\n")
    assert (good, problem["type"], problem["status"]) == (False, "urn:shape-concepts:error:internal", 500)
    assert "shutdown" not in json.dumps(problem)


def test_many_robots_get_the_answers_of_one(
    replica: Application, robot: zenoh.Session, clouds: list[PointCloud]
) -> None:
    contents = [write_ply(cloud) for cloud in clouds]
    alone = [ask(robot, "tiny/respond", content)[2] for content in contents]
    with ThreadPoolExecutor(8) as threads:
        numbers = list(range(len(contents))) * 4
        for number, (good, _, answer) in zip(
            numbers, threads.map(lambda n: ask(robot, "tiny/respond", contents[n]), numbers), strict=True
        ):
            if good:
                assert {**answer, "timings_ms": 0} == {**alone[number], "timings_ms": 0}
            else:
                assert answer["status"] == 429


def test_of_two_replicas_one_replies_unless_all_are_asked(
    served: Served, robot: zenoh.Session, clouds: list[PointCloud]
) -> None:
    served()
    served()
    content = write_ply(clouds[0])
    for _ in range(5):
        assert len(replies(robot, "tiny/respond", content)) == 1
    everybody = zenoh.ConsolidationMode.NONE
    assert len(replies(robot, "tiny/respond", content, target=zenoh.QueryTarget.ALL, consolidation=everybody)) == 2


def test_a_particular_replica_can_be_asked(served: Served, robot: zenoh.Session, clouds: list[PointCloud]) -> None:
    applications = [served(), served()]
    content = write_ply(clouds[0])
    with contextlib.ExitStack() as stack:
        for _ in range(applications[0].pool.places):  # one of them has too much to do
            stack.enter_context(applications[0].pool.admitted())
        outcomes = []
        for token in replicas(robot):
            (reply,) = robot.get(f"{token}/models/tiny/respond", payload=content, timeout=20)
            outcomes.append(reply.ok is not None)
        assert sorted(outcomes) == [False, True]


def test_where_access_keys_are_needed_a_query_bears_one_as_its_attachment(
    served: Served, robot: zenoh.Session, settings: Settings, clouds: list[PointCloud]
) -> None:
    keys = KeyStore(settings.store)
    answering, training = keys.create("a", ("answer",)).text, keys.create("b", ("train",)).text
    served(access="keys")
    content = write_ply(clouds[0])
    assert ask(robot, "tiny/respond", content, attachment=answering)[0]
    for attachment, kind in (
        (None, "not-authenticated"),
        (b"sc_wrong", "not-authenticated"),
        (b"\xff\xfe", "not-authenticated"),
        (bytes(5000), "not-authenticated"),
        (training, "not-allowed"),
    ):
        good, _, problem = ask(robot, "tiny/respond", content, attachment=attachment)
        assert (good, problem["type"]) == (False, f"urn:shape-concepts:error:{kind}")


def test_the_limits_of_a_key_hold(
    served: Served, robot: zenoh.Session, settings: Settings, clouds: list[PointCloud]
) -> None:
    keys = KeyStore(settings.store)
    fits, large = (write_ply(PointCloud(clouds[0].points[:points])) for points in (500, 501))
    few = keys.create("a", ("answer",), max_points=500).text
    short = keys.create("b", ("answer",), max_body=len(large) - 1).text
    served(access="keys")
    assert ask(robot, "tiny/respond", fits, attachment=few)[0]
    for selector in ("tiny/respond", "tiny/respond?scene=true"):
        for attachment, kind, limit in (
            (few, "too-many-points", "500"),
            (short, "content-too-large", str(len(large) - 1)),
        ):
            good, _, problem = ask(robot, selector, large, attachment=attachment)
            assert (good, problem["status"], problem["type"].rpartition(":")[2]) == (False, 413, kind)
            assert limit in problem["detail"]


def test_a_replica_that_ends_leaves_no_session_and_no_thread(served: Served, robot: zenoh.Session) -> None:
    application = served()
    (first,) = replicas(robot)
    before = {thread.name for thread in threading.enumerate() if not thread.daemon}
    with running(application):
        assert len(replicas(robot)) in (1, 2)
    assert {thread.name for thread in threading.enumerate() if not thread.daemon} <= before
    assert replicas(robot) == [first]
