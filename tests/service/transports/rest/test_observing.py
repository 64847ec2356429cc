"""What is seen of HTTP requests from outside, as Prometheus's own parser and a reader of the log see it."""

from __future__ import annotations

import json
import logging
import time

import httpx
import pytest

from service.keys import KeyStore
from service.logs import JsonLines
from service.settings import Settings
from service.transports.rest.examples import CLOUD_XYZ
from tests.service.measured import parsed
from tests.service.transports.rest.test_access import bearing


def measured(client: httpx.Client) -> dict[tuple[object, ...], float]:
    """Metrics once no request is under way but that for them: a request ends a little later than its answer."""
    for _ in range(500):
        found = parsed(client.get("/metrics").text)
        if found["shape_concepts_requests_under_way", ("wire", "rest")] == 1:
            return found
        time.sleep(0.01)
    raise AssertionError("requests do not end")


def requests(client: httpx.Client) -> dict[tuple[str, str], float]:
    """How many requests ended, by operation and outcome."""
    found = measured(client)
    return {
        (dict(labels)["operation"], dict(labels)["outcome"]): value  # type: ignore[call-overload]
        for (name, *labels), value in found.items()
        if name == "shape_concepts_requests_total" and dict(labels)["wire"] == "rest"  # type: ignore[call-overload]
    }


def test_requests_are_counted_by_route_and_outcome(client: httpx.Client) -> None:
    client.get("/healthz")
    client.post("/v1/responses", content=CLOUD_XYZ)
    client.post("/v1/responses", content=b"1 2 3\n" * 3)
    client.post("/v1/responses", content=CLOUD_XYZ, params={"top": "many"})
    client.get("/v1/models/tiny/versions/1")
    client.get("/v1/models/none/versions/1")
    found = requests(client)
    manifest = "GET /v1/models/{name}/versions/{version}"
    assert found["GET /healthz", "ok"] == 1
    assert found["POST /v1/responses", "ok"] == 1
    assert found["POST /v1/responses", "too-few-points"] == 1
    assert found["POST /v1/responses", "invalid-parameter"] == 1
    assert (found[manifest, "ok"], found[manifest, "model-not-found"]) == (1, 1)


def test_nothing_that_a_client_writes_becomes_a_label(client: httpx.Client) -> None:
    for i in range(20):
        client.get(f"/secret-{i}")
        client.get(f"/v1/models/secret-{i}/versions/1", headers={"traceparent": f"secret-{i}"})
        client.request(f"SECRET{i}", "/v1/models")
        client.post("/v1/responses", content=CLOUD_XYZ, params={"model": f"secret-{i}", f"secret-{i}": "1"})
        client.post("/v1/responses", content=b"secret", headers={"content-type": f"secret/{i}"})
    page = client.get("/metrics").text
    assert "secret" not in page.lower()
    assert requests(client)["other", "not-found"] == 20
    assert len(requests(client)) < 10


def test_stages_are_timed_by_wire_and_levels_are_told(client: httpx.Client) -> None:
    answer = client.post("/v1/responses", content=CLOUD_XYZ).json()
    found = measured(client)
    for stage in answer["timings_ms"]:
        assert found["shape_concepts_stage_seconds_count", ("stage", stage), ("wire", "rest")] == 1
    assert found["shape_concepts_queue_places",] == 4
    assert found["shape_concepts_intake_bytes",] == 0
    assert found["shape_concepts_model_version", ("alias", "production"), ("model", "tiny")] == 1


def test_whoever_asks_for_openmetrics_gets_it(client: httpx.Client) -> None:
    assert client.get("/metrics").headers["content-type"].startswith("text/plain; version=")
    response = client.get("/metrics", headers={"Accept": "application/openmetrics-text; version=1.0.0"})
    assert response.headers["content-type"].startswith("application/openmetrics-text")
    assert response.text.endswith("# EOF\n")


def test_each_request_ends_with_a_line_that_says_whose_it_was(
    guarded: httpx.Client,
    settings: Settings,
    caplog: pytest.LogCaptureFixture,
) -> None:
    text, key = KeyStore(settings.store).create("robot-7", ("answer",))
    with caplog.at_level(logging.INFO, "service.telemetry"):
        answered = guarded.post("/v1/responses", content=CLOUD_XYZ, headers=bearing(text))
        refused = guarded.get("/v1/models%0A/secret")
        for _ in range(500):
            lines = [json.loads(JsonLines().format(record)) for record in caplog.records]
            if len(lines) == 2:
                break
            time.sleep(0.01)  # a line is written a little later than its answer is sent
    by_id = {line["request_id"]: line for line in lines}
    first, second = by_id[answered.headers["x-request-id"]], by_id[refused.headers["x-request-id"]]
    assert (first["wire"], first["operation"], first["outcome"]) == ("rest", "POST /v1/responses", "ok")
    assert (first["caller"], first["model"]) == (key.id, "tiny:1")
    assert first["duration_ms"] >= sum(answered.json()["timings_ms"].values())
    assert (second["operation"], second["outcome"]) == ("other", "not-found")
    assert "secret" not in caplog.text
    assert text not in caplog.text


def test_metrics_are_for_who_manages_where_keys_are_needed(guarded: httpx.Client, settings: Settings) -> None:
    keys = KeyStore(settings.store)
    answering, managing = keys.create("a", ("answer",)).text, keys.create("b", ("manage",)).text
    assert guarded.get("/metrics").status_code == 401
    assert guarded.get("/metrics", headers=bearing(answering)).status_code == 403
    assert guarded.get("/metrics", headers=bearing(managing)).status_code == 200
