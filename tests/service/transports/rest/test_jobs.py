"""/v1/jobs by a real client of a real server; no worker is needed to submit, look, follow and cancel."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import httpx
import pytest

from service.application import Application
from service.jobs import Jobs
from service.settings import Settings
from service.training import FOLLOWERS

SPEC = {"kind": "train", "name": "toys", "simulate": 2}


@pytest.fixture
def queue(settings: Settings) -> Iterator[Jobs]:
    """The queue, as a worker has it."""
    queue = Jobs(settings.jobs_url)
    yield queue
    queue.close()


def submit(client: httpx.Client, key: str, **given: object) -> httpx.Response:
    return client.post("/v1/jobs", json=SPEC | given, headers={"Idempotency-Key": key})


class Event:
    """A server-sent event."""

    def __init__(self, text: str) -> None:
        fields = dict(line.split(": ", 1) for line in text.splitlines() if ": " in line)
        self.kind, self.id, self.data = fields.get("event"), fields.get("id"), json.loads(fields.get("data", "null"))


def events(response: httpx.Response) -> Iterator[Event]:
    """The events of an answer as they come."""
    text = ""
    for piece in response.iter_text():
        text += piece
        while "\n\n" in text:
            event, _, text = text.partition("\n\n")
            if event.startswith("event: "):
                yield Event(event)


def test_a_job_is_accepted_and_can_be_asked_for(client: httpx.Client) -> None:
    accepted = client.post("/v1/jobs", json=SPEC)
    assert accepted.status_code == 202
    job = accepted.json()
    assert (job["state"], job["spec"]["simulate"]) == ("queued", 2)
    assert accepted.headers["Location"] == f"/v1/jobs/{job['id']}"
    assert client.get(accepted.headers["Location"]).json() == job


def test_a_request_repeated_with_its_key_is_one_job(client: httpx.Client) -> None:
    assert submit(client, "nightly").json() == submit(client, "nightly").json() == submit(client, '"nightly"').json()
    assert [job["id"] for job in client.get("/v1/jobs").json()["jobs"]] == ["nightly"]
    other = submit(client, "nightly", simulate=3)
    assert (other.status_code, other.json()["type"]) == (422, "urn:shape-concepts:error:invalid-parameter")


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"simulate": None}, "at least one of"),
        ({"kind": "paint"}, "kind"),
        ({"speed": 3}, "speed"),
        ({"clouds": "/etc"}, "upload a dataset"),
        ({"params": {"patches": {"iterations": 0}}}, "iterations"),
        ({"parent": "nobody:3"}, "nobody"),
    ],
)
def test_a_job_that_cannot_be_is_refused(client: httpx.Client, given: dict[str, object], told: str) -> None:
    refused = submit(client, "nightly", **given)
    assert refused.status_code in (404, 422)
    assert told in refused.json()["detail"]
    assert client.get("/v1/jobs").json() == {"jobs": [], "next": None}


@pytest.mark.parametrize("key", ["Upper", "a" * 64, "../up", '""'])
def test_a_key_that_cannot_be_an_id_is_refused(client: httpx.Client, key: str) -> None:
    assert submit(client, key).status_code == 422


def test_pages_are_walked_and_states_chosen(client: httpx.Client) -> None:
    for number in range(5):
        submit(client, f"job-{number}")
    client.post("/v1/jobs/job-1/cancel")
    ids: list[str] = []
    page: dict[str, Any] = {"next": None}
    while not ids or page["next"]:
        page = client.get("/v1/jobs", params={"limit": 2} | ({"before": page["next"]} if page["next"] else {})).json()
        ids += [job["id"] for job in page["jobs"]]
    assert ids == [f"job-{number}" for number in (4, 3, 2, 1, 0)]
    assert [job["id"] for job in client.get("/v1/jobs?state=cancelled").json()["jobs"]] == ["job-1"]
    assert client.get("/v1/jobs?before=nobody").status_code == 404
    assert client.get("/v1/jobs?state=lost").status_code == 422


def test_what_nobody_submitted_is_not_found(client: httpx.Client) -> None:
    for method, path in [("GET", ""), ("GET", "/logs"), ("GET", "/events"), ("POST", "/cancel"), ("POST", "/retry")]:
        answer = client.request(method, f"/v1/jobs/nobody{path}")
        assert (answer.status_code, answer.json()["type"]) == (404, "urn:shape-concepts:error:job-not-found")
    submit(client, "nightly")
    assert client.get("/v1/jobs/nightly/report.html").status_code == 404


def test_a_job_is_cancelled_and_retried(client: httpx.Client) -> None:
    submit(client, "nightly")
    for path, state in [("cancel", "cancelled"), ("cancel", "cancelled"), ("retry", "queued"), ("retry", "queued")]:
        assert client.post(f"/v1/jobs/nightly/{path}").json()["state"] == state
    log = client.get("/v1/jobs/nightly/logs").json()
    assert [line["line"] for line in log["lines"]] == ["cancelled", "queued again"]
    assert [line["number"] for line in client.get("/v1/jobs/nightly/logs?after=1").json()["lines"]] == [2]


def test_who_follows_a_job_is_told_everything_once_and_when_it_is_over(client: httpx.Client, queue: Jobs) -> None:
    submit(client, "nightly")
    queue.note("nightly", "first")
    with client.stream("GET", "/v1/jobs/nightly/events") as response:
        assert response.headers["Content-Type"].startswith("text/event-stream")
        coming = events(response)
        line, job = next(coming), next(coming)
        assert (line.kind, line.id, line.data["line"]) == ("log", "1", "first")
        assert (job.kind, job.data["state"]) == ("job", "queued")
        queue.note("nightly", "second\nevent: end")
        line = next(coming)
        assert (line.id, line.data["line"]) == ("2", "second\nevent: end")
        queue.cancel("nightly")
        rest = list(coming)
    assert [event.kind for event in rest if event.kind != "log"] == ["job", "end"]
    assert [event.data["line"] for event in rest if event.kind == "log"] == ["cancelled"]
    assert rest[-1].data == {"state": "cancelled"}


def test_who_comes_back_is_told_what_was_missed(client: httpx.Client, queue: Jobs) -> None:
    submit(client, "nightly")
    for line in ("first", "second", "third"):
        queue.note("nightly", line)
    queue.cancel("nightly")
    for asked in ({"headers": {"Last-Event-ID": "2"}}, {"params": {"after": 2}}):
        with client.stream("GET", "/v1/jobs/nightly/events", **asked) as response:  # type: ignore[arg-type]
            told = list(events(response))
        assert [event.id for event in told if event.kind == "log"] == ["3", "4"]
        assert told[-1].kind == "end"
    assert client.get("/v1/jobs/nightly/events", headers={"Last-Event-ID": "x"}).status_code == 422


def test_only_so_many_follow_at_a_time_and_those_who_left_make_room(
    client: httpx.Client, application: Application
) -> None:
    submit(client, "nightly")
    with ExitStack() as stack:
        for _ in range(FOLLOWERS - 1):
            stack.enter_context(application.training.following())
        with client.stream("GET", "/v1/jobs/nightly/events") as first:
            coming = events(first)
            next(coming)
            with client.stream("GET", "/v1/jobs/nightly/events") as refused:
                assert (refused.status_code, refused.headers["Retry-After"]) == (429, "1")
    application.training.cancel("nightly")
    assert client.get("/v1/jobs/nightly/events").status_code == 200


def test_those_who_follow_are_let_go_when_the_service_ends(client: httpx.Client, application: Application) -> None:
    submit(client, "nightly")
    with client.stream("GET", "/v1/jobs/nightly/events") as response:
        coming = events(response)
        assert next(coming).kind == "job"
        began = time.monotonic()
        application.training.ending.set()
        assert not list(coming)
    assert time.monotonic() - began < 5


def test_a_database_out_of_reach_is_told_without_its_place(client: httpx.Client, settings: Settings) -> None:
    file = settings.jobs_url.removeprefix("sqlite:///")
    with open(file, "w") as broken:
        broken.write("no database " * 1000)
    for answer in (client.get("/v1/jobs"), submit(client, "nightly")):
        assert (answer.status_code, answer.json()["type"]) == (503, "urn:shape-concepts:error:jobs-unavailable")
        assert file not in answer.text
