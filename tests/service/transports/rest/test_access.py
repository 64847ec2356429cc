"""Access keys over HTTP, by a real client of a real server."""

from __future__ import annotations

import time
from typing import Any

import httpx
import pytest

from service.application import Application
from service.clouds import write_ply
from service.engine.cloud import PointCloud
from service.keys import KeyStore
from service.main import http_app
from service.settings import Settings
from service.transports.rest.examples import CLOUD_XYZ


def bearing(text: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {text}"}


def test_without_a_key_nothing_but_health_is_told(guarded: httpx.Client) -> None:
    assert guarded.get("/healthz").status_code == 200
    assert guarded.get("/readyz").status_code == 200
    for refused in (
        guarded.get("/v1/models"),
        guarded.post("/v1/responses", content=CLOUD_XYZ),
        guarded.get("/v1/models", headers=bearing("sc_wrong")),
        guarded.get("/v1/models", headers={"Authorization": "Basic eDp5"}),
    ):
        assert refused.status_code == 401
        assert refused.headers["WWW-Authenticate"] == "Bearer"
        assert refused.headers["Content-Type"] == "application/problem+json"
        assert refused.json()["type"].endswith("not-authenticated")


def test_a_key_is_let_in_and_its_scope_holds(guarded: httpx.Client, settings: Settings) -> None:
    keys = KeyStore(settings.store)
    answering, training = keys.create("a", ("answer",)).text, keys.create("b", ("train",)).text
    time.sleep(1.1)  # the service believes what it read for a second
    answered = guarded.post("/v1/responses", content=CLOUD_XYZ, headers=bearing(answering))
    assert answered.status_code == 200, answered.text
    assert guarded.get("/v1/models", headers=bearing(answering)).status_code == 200
    refused = guarded.post("/v1/responses", content=CLOUD_XYZ, headers=bearing(training))
    assert refused.status_code == 403
    assert "not to answer" in refused.json()["detail"]


def test_a_key_that_is_used_too_much_is_told_when_to_come_back(guarded: httpx.Client, settings: Settings) -> None:
    text = KeyStore(settings.store).create("hasty", ("answer",), rate=0.1).text
    codes = [guarded.get("/v1/models", headers=bearing(text)) for _ in range(3)]
    assert [each.status_code for each in codes] == [200, 429, 429]
    assert int(codes[-1].headers["Retry-After"]) >= 1


@pytest.mark.parametrize("access", ["open", "keys"])
def test_the_description_says_whether_keys_are_needed(settings: Settings, access: str) -> None:
    application = Application(settings.model_copy(update={"access": access}))
    paths = http_app(application).openapi()["paths"]
    application.close()
    for operation in (paths["/v1/models"]["get"], paths["/v1/responses"]["post"], paths["/v2"]["get"]):
        assert ({} in operation["security"]) == (access == "open")
    assert "security" not in paths["/healthz"]["get"]


def test_a_revoked_key_is_refused_within_seconds(guarded: httpx.Client, settings: Settings) -> None:
    keys = KeyStore(settings.store)
    text, key = keys.create("gone", ("answer",))
    assert guarded.get("/v1/models", headers=bearing(text)).status_code == 200
    keys.revoke(key.id)
    time.sleep(1.2)
    guarded.get("/v1/models", headers=bearing(text))
    assert guarded.get("/v1/models", headers=bearing(text)).status_code == 401


def test_the_description_says_where_a_key_is_needed(guarded: httpx.Client) -> None:
    paths = guarded.get("/openapi.json").json()["paths"]
    needing = {path for path, methods in paths.items() for each in methods.values() if each.get("security")}
    assert {path for path in paths if path.startswith("/v1/")} == needing
    for path in needing:
        assert all({"401", "403", "429"} <= set(each["responses"]) for each in paths[path].values())


def test_where_everybody_may_ask_a_key_does_no_harm(client: httpx.Client) -> None:
    assert client.get("/v1/models", headers=bearing("sc_wrong")).status_code == 200


@pytest.mark.parametrize(
    ("method", "path", "scope"),
    [
        ("POST", "/v1/responses/batch", "answer"),
        ("GET", "/v1/models/tiny/concepts", "answer"),
        ("GET", "/v1/models/tiny/names", "answer"),
        ("POST", "/v1/models/tiny:1/promote", "manage"),
        ("POST", "/v1/models/tiny/rollback?leaving=9", "manage"),
        ("PUT", "/v1/models/tiny/concepts/14/name", "manage"),
        ("DELETE", "/v1/models/tiny/concepts/14/name", "manage"),
        ("POST", "/v1/models/tiny/names/propose?apply=true", "manage"),
    ],
)
def test_who_may_have_answers_may_read_and_only_who_manages_may_alter(
    guarded: httpx.Client, settings: Settings, method: str, path: str, scope: str
) -> None:
    keys = KeyStore(settings.store)
    sent = {name: bearing(keys.create(name, (name,)).text) for name in ("answer", "manage")}
    status = {name: guarded.request(method, path, headers=headers).status_code for name, headers in sent.items()}
    other = next(name for name in sent if name != scope)
    assert status[scope] not in (401, 403)
    assert status[other] == 403


def test_who_answers_or_trains_sees_jobs_and_only_who_trains_alters_them(
    guarded: httpx.Client, settings: Settings
) -> None:
    keys = KeyStore(settings.store)
    sent = {name: bearing(keys.create(name, (name,)).text) for name in ("answer", "train", "manage")}
    time.sleep(1.1)
    job = {"kind": "simulate", "dataset": "toys", "count": 1}
    altering = {
        name: guarded.post("/v1/jobs", json=job, headers={**headers, "Idempotency-Key": "one"}).status_code
        for name, headers in sent.items()
    }
    assert altering == {"answer": 403, "train": 202, "manage": 403}
    for method, path, allowed in [
        ("GET", "/v1/jobs", {"answer", "train"}),
        ("GET", "/v1/jobs/one", {"answer", "train"}),
        ("GET", "/v1/jobs/one/logs", {"answer", "train"}),
        ("POST", "/v1/jobs/one/cancel", {"train"}),
        ("POST", "/v1/jobs/one/retry", {"train"}),
    ]:
        told = {name: guarded.request(method, path, headers=headers).status_code for name, headers in sent.items()}
        assert told == {name: 200 if name in allowed else 403 for name in sent}, path


def files(*contents: bytes) -> list[tuple[str, tuple[str, bytes]]]:
    return [("cloud", ("object.bin", content)) for content in contents]


def problems_of(response: httpx.Response) -> list[dict[str, Any]]:
    """The problem of a request, or those of its clouds."""
    document = response.json()
    if response.status_code != 200:
        return [document]
    return [item["problem"] for item in document.get("items") or document.get("left_out") or () if "problem" in item]


def thinned(cloud: PointCloud, points: int) -> bytes:
    return write_ply(PointCloud(cloud.points[:: len(cloud.points) // points][:points]))


@pytest.mark.parametrize("ask", ["responses", "responses?scene=true", "responses/batch", "models/tiny/names/propose"])
def test_a_key_has_as_many_points_answered_as_it_may(
    guarded: httpx.Client, settings: Settings, clouds: list[PointCloud], ask: str
) -> None:
    keys = KeyStore(settings.store)
    headers = bearing(keys.create("few", ("answer", "manage"), max_points=500).text)
    labels = {"label": ["mug"]} if "propose" in ask else {}
    for points, refused in ((501, True), (500, False)):
        sent = files(thinned(clouds[0], points))
        problems = problems_of(guarded.post(f"/v1/{ask}", files=sent, data=labels, headers=headers))
        assert refused == ([problem["status"] for problem in problems] == [413])
        if refused:
            assert problems[0]["type"].endswith("too-many-points")
            assert "over the limit of 500; crop" in problems[0]["detail"]


@pytest.mark.parametrize("ask", ["responses/batch", "models/tiny/names/propose"])
def test_several_clouds_count_as_many_as_they_are(guarded: httpx.Client, settings: Settings, ask: str) -> None:
    """More than the key has in a second are answered, and then paid off."""
    headers = bearing(KeyStore(settings.store).create("slow", ("answer", "manage"), rate=0.1).text)
    labels = {"label": ["mug"] * 5} if "propose" in ask else {}
    sent = {"files": files(*[b"0 0 1"] * 5), "data": labels, "headers": headers}
    assert guarded.post(f"/v1/{ask}", **sent).status_code == 200
    refused = guarded.get("/v1/models", headers=headers)
    assert refused.status_code == 429
    assert 30 < int(refused.headers["Retry-After"]) <= 50


def test_a_batch_beyond_the_rate_is_refused_whole(guarded: httpx.Client, settings: Settings) -> None:
    headers = bearing(KeyStore(settings.store).create("hasty", ("answer",), rate=20).text)
    first, second = (guarded.post("/v1/responses/batch", json=[[]] * 20, headers=headers) for _ in range(2))
    assert first.status_code == 200
    assert (second.status_code, second.json()["type"].rpartition(":")[2]) == (429, "rate-exceeded")
    assert second.headers["Retry-After"] == "1"
    assert "20 requests a second" in second.json()["detail"]


@pytest.mark.parametrize("ask", ["responses", "responses/batch"])
def test_a_key_sends_bodies_as_large_as_it_may(guarded: httpx.Client, settings: Settings, ask: str) -> None:
    body = str([[[0, 0, 1]] * 200] * 3 if "batch" in ask else [[0, 0, 1]] * 200).encode()
    keys = KeyStore(settings.store)
    fits, short = (bearing(keys.create("a", ("answer",), max_body=len(body) - less).text) for less in (0, 1))
    json = {"Content-Type": "application/json"}
    allowed = guarded.post(f"/v1/{ask}", content=body, headers=fits | json)
    assert "content-too-large" not in allowed.text
    for sent in (body, (body[i : i + 100] for i in range(0, len(body), 100))):  # its length announced, and not
        refused = guarded.post(f"/v1/{ask}", content=sent, headers=short | json)
        assert (refused.status_code, refused.json()["type"].rpartition(":")[2]) == (413, "content-too-large")
        assert str(len(body) - 1) in refused.json()["detail"]


def test_a_key_sends_as_many_clouds_at_a_time_as_it_may(guarded: httpx.Client, settings: Settings) -> None:
    headers = bearing(KeyStore(settings.store).create("two", ("answer", "manage"), max_batch=2).text)
    cloud = CLOUD_XYZ.encode()
    for count, status in ((2, 200), (3, 413)):
        labels = {"label": ["mug"] * count}
        for answered in (
            guarded.post("/v1/responses/batch", files=files(*[cloud] * count), headers=headers),
            guarded.post("/v1/responses/batch", json=[[[0, 0, 1]]] * count, headers=headers),
            guarded.post("/v1/models/tiny/names/propose", files=files(*[cloud] * count), data=labels, headers=headers),
        ):
            assert answered.status_code == status, answered.text
            assert status == 200 or "more than 2 clouds; send them in several requests" in answered.json()["detail"]
