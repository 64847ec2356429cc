"""Access keys over HTTP, by a real client of a real server."""

from __future__ import annotations

import time

import httpx
import pytest

from service.keys import KeyStore
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
