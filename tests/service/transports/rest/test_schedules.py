"""/v1/schedules: made, looked at, paused, resumed and removed."""

from __future__ import annotations

from typing import Any

import httpx
import pytest

WEEKLY: dict[str, Any] = {"name": "weekly", "cron": "0 3 * * mon", "job": {"name": "toys", "simulate": 2}}


def test_a_schedule_comes_and_goes(client: httpx.Client) -> None:
    assert client.get("/v1/schedules").json() == {"schedules": []}
    for _ in range(2):
        made = client.post("/v1/schedules", json=WEEKLY)
        assert made.status_code == 201, made.text
    assert (made.json()["state"], made.json()["zone"], made.json()["job"]["simulate"]) == ("active", "UTC", 2)
    assert client.get("/v1/schedules").json()["schedules"] == [made.json()]
    assert client.get("/v1/schedules/weekly").json() == made.json()
    assert client.post("/v1/schedules/weekly/pause").json()["state"] == "paused"
    assert client.post("/v1/schedules/weekly/resume").json()["state"] == "active"
    assert client.delete("/v1/schedules/weekly").json()["name"] == "weekly"
    assert client.delete("/v1/schedules/weekly").json()["type"] == "urn:shape-concepts:error:schedule-not-found"


@pytest.mark.parametrize(
    ("changed", "status"),
    [
        ({"cron": "soon"}, 422),
        ({"zone": "Mars/Olympus"}, 422),
        ({"name": "Weekly"}, 422),
        ({"job": {"name": "toys"}}, 422),
        ({"job": {"name": "toys", "clouds": "/etc"}}, 422),
        ({"job": {"name": "toys", "extend": "nobody"}}, 404),
        ({"job": []}, 422),
        ({"every": "day"}, 422),
    ],
)
def test_what_cannot_be_is_a_problem_and_makes_none(client: httpx.Client, changed: dict[str, Any], status: int) -> None:
    refused = client.post("/v1/schedules", json=WEEKLY | changed)
    assert (refused.status_code, refused.json()["status"]) == (status, status), refused.text
    assert client.get("/v1/schedules").json() == {"schedules": []}


def test_another_schedule_of_the_name_is_a_conflict(client: httpx.Client) -> None:
    client.post("/v1/schedules", json=WEEKLY)
    refused = client.post("/v1/schedules", json=WEEKLY | {"cron": "1 3 * * mon"})
    assert (refused.status_code, refused.json()["type"]) == (409, "urn:shape-concepts:error:schedule-exists")


def test_only_keys_that_may_train_see_schedules(guarded: httpx.Client) -> None:
    for method, path in (("GET", "/v1/schedules"), ("POST", "/v1/schedules"), ("DELETE", "/v1/schedules/weekly")):
        assert guarded.request(method, path).status_code == 401
