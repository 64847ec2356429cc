"""The interface as a whole: health, errors of the framework, and a description whose examples are true."""

from __future__ import annotations

import json
import logging
import re
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import httpx
import jsonschema
import pytest

from service.application import Application
from service.archives import write
from service.clouds import FORMATS
from service.engine.model import ShapeModel
from service.settings import Settings


def test_a_ready_service_says_which_model_it_serves(client: httpx.Client) -> None:
    assert client.get("/readyz").json() == {"model": "tiny", "version": 1, "models": ["tiny"], "built_in": False}
    assert client.get("/healthz").json() == {"status": "ok"}


class TestWithoutModel:
    @pytest.fixture
    def settings(self, settings: Settings, tmp_path: Path) -> Settings:
        return settings.model_copy(update={"store": str(tmp_path / "nothing"), "built_in": False})

    def test_it_lives_but_is_not_ready(self, client: httpx.Client) -> None:
        assert client.get("/healthz").status_code == 200
        response = client.get("/readyz")
        assert (response.status_code, response.json()["status"]) == (503, 503)
        assert response.headers["content-type"] == "application/problem+json"
        assert client.get("/v1/models").json() == {"models": []}
        assert client.post("/v1/responses", content=b"1 2 3\n").status_code == 404


class TestWithoutStore:
    @pytest.fixture
    def settings(self, settings: Settings, tmp_path: Path) -> Settings:
        (tmp_path / "file").write_bytes(b"")
        return settings.model_copy(update={"store": str(tmp_path / "file")})

    def test_it_lives_and_keeps_to_itself_where_the_store_is(self, client: httpx.Client, tmp_path: Path) -> None:
        assert client.get("/healthz").status_code == 200
        for response in (client.get("/readyz"), client.get("/v1/models"), client.post("/v1/responses", content=b"1")):
            assert response.status_code == 503
            assert response.json()["type"] == "urn:shape-concepts:error:store-unavailable"
            assert str(tmp_path) not in response.text
            assert "retry-after" in response.headers


@pytest.mark.parametrize(
    ("method", "path", "status", "kind"),
    [
        ("GET", "/elsewhere", 404, "not-found"),
        ("GET", "/v1/nothing", 404, "not-found"),
        ("GET", "/v1/responses", 405, "method-not-allowed"),
        ("DELETE", "/v1/models", 405, "method-not-allowed"),
    ],
)
def test_what_the_framework_refuses_is_a_problem_as_well(
    client: httpx.Client, method: str, path: str, status: int, kind: str
) -> None:
    response = client.request(method, path)
    assert (response.status_code, response.headers["content-type"]) == (status, "application/problem+json")
    assert response.json()["type"] == f"urn:shape-concepts:error:{kind}"
    assert "allow" in response.headers or status != 405


class TestWithAFault:
    @pytest.fixture
    def application(self, settings: Settings) -> Iterator[Application]:
        class Faulty(Application):
            def which(self, *asked: Any, **more: Any) -> tuple[str, int]:
                raise RuntimeError("the secret inside")

        application = Faulty(settings)
        yield application
        application.close()

    def test_it_is_logged_whole_and_answered_plainly(
        self, client: httpx.Client, caplog: pytest.LogCaptureFixture
    ) -> None:
        with caplog.at_level(logging.ERROR):
            response = client.get("/v1/models/tiny/concepts")
        assert (response.status_code, response.json()["type"]) == (500, "urn:shape-concepts:error:internal")
        assert response.headers["content-type"] == "application/problem+json"
        assert "secret" not in response.text
        assert "the secret inside" in caplog.text
        assert response.headers["x-request-id"] in caplog.text
        assert client.get("/healthz").status_code == 200


def test_a_damaged_model_is_refused_with_the_reason(client: httpx.Client, application: Application) -> None:
    for blob in (Path(application.settings.store) / "blobs" / "sha256").iterdir():
        blob.write_bytes(blob.read_bytes()[:-1])
    response = client.post("/v1/responses", content=b"1 2 3\n")
    assert (response.status_code, response.json()["type"]) == (500, "urn:shape-concepts:error:model-damaged")
    assert "cut off" in response.json()["detail"]
    assert client.get("/readyz").status_code == 503


@pytest.mark.parametrize("page", ["/docs", "/redoc"])
def test_the_pages_that_describe_it_need_no_internet(client: httpx.Client, page: str) -> None:
    response = client.get(page)
    assert response.status_code == 200
    assert "://" not in response.text
    linked = re.findall(r'(?:src|href)="([^"]+)"', response.text)
    assert len(linked) > 1
    for path in linked:
        assert client.get(path).status_code == 200, path


FILES = {kind for entry in FORMATS.values() for kind in entry.media_types} - {"application/json"}
FILES |= {"application/zip", "application/gzip", "text/html", "text/event-stream"}


def contents(description: dict[str, Any]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Operation, status and content of every documented answer."""
    for path, operations in description["paths"].items():
        for method, operation in operations.items():
            for status, answer in operation["responses"].items():
                for media_type, content in answer.get("content", {}).items():
                    if media_type not in FILES:
                        assert media_type == ("application/json" if status < "300" else "application/problem+json")
                        yield f"{method} {path}", status, content


def examples_of(content: dict[str, Any]) -> list[dict[str, Any]]:
    return [content["example"]] if "example" in content else [e["value"] for e in content["examples"].values()]


def test_every_answer_is_described_with_an_example_that_fits_its_schema(client: httpx.Client) -> None:
    description = client.get("/openapi.json").json()
    seen = set()
    for operation, status, content in contents(description):
        seen.add((operation, status))
        for example in examples_of(content):
            jsonschema.validate(example, {**content.get("schema", {}), "components": description["components"]})
            if status >= "400":
                assert example["status"] == int(status)
    for status in ("200", "400", "404", "408", "413", "415", "422", "429", "500", "503"):
        assert ("post /v1/responses", status) in seen
    assert {operation for operation, _ in seen} == {
        f"{method} {path}" for path, operations in description["paths"].items() for method in operations
    }


def test_what_is_so_still_is_described_wherever_a_tag_is_given(client: httpx.Client) -> None:
    for path, operations in client.get("/openapi.json").json()["paths"].items():
        for method, operation in operations.items():
            conditional = "If-None-Match".lower() in {p["name"].lower() for p in operation.get("parameters", [])}
            assert (
                conditional
                == ("304" in operation["responses"])
                == (method == "get" and "v1" in path[:4] and not path.endswith((".png", "events", ".json", ".html")))
            )


def test_every_field_and_parameter_is_described(client: httpx.Client) -> None:
    description = client.get("/openapi.json").json()
    for name, described in description["components"]["schemas"].items():
        for field, schema in described.get("properties", {}).items():
            assert schema.get("description") or "$ref" in schema, f"{name}.{field}"
    for operations in description["paths"].values():
        for operation in operations.values():
            for parameter in operation.get("parameters", []):
                assert parameter["description"], parameter["name"]


HELD = ("/concepts", "/barcode", "/annexations", "/tree", "/names", "/labels")


def asked_of_datasets(client: httpx.Client, cloud: str) -> dict[str, httpx.Response]:
    """Every operation on datasets, once."""
    one = "/v1/datasets/{name}"
    cloud_json = json.dumps([[float(part) for part in line.split()] for line in cloud.splitlines()])
    archive = b"".join(write([("a.xyz", cloud.encode()), ("b.ply", b"ply")], "zip", datetime.now(UTC)))
    asked = {
        f"put {one}": client.put("/v1/datasets/mugs", json={"description": "some"}),
        f"put {one}/clouds/{{key}}": client.put("/v1/datasets/mugs/clouds/a.json?category=mug", content=cloud_json),
        f"get {one}/clouds/{{key}}": client.get("/v1/datasets/mugs/clouds/a.json"),
        f"post {one}/archive": client.post("/v1/datasets/mugs/archive", content=archive),
        f"put {one}/labels": client.put("/v1/datasets/mugs/labels", content="file,category\na.xyz,mug\n"),
        f"get {one}": client.get("/v1/datasets/mugs"),
        f"get {one}/clouds": client.get("/v1/datasets/mugs/clouds"),
        "get /v1/datasets": client.get("/v1/datasets"),
        f"post {one}/uploads": client.post("/v1/datasets/mugs/uploads", json={"length": len(archive)}),
    }
    place = asked[f"post {one}/uploads"].headers["location"]
    asked[f"patch {one}/uploads/{{upload}}"] = client.patch(place, content=archive, headers={"Upload-Offset": "0"})
    asked[f"get {one}/uploads/{{upload}}"] = client.get(place)
    asked[f"post {one}/uploads/{{upload}}/finish"] = client.post(f"{place}/finish")
    return asked


def test_real_answers_fit_the_description(client: httpx.Client, application: Application, model: ShapeModel) -> None:
    application.store.publish(model, name="tiny", seed=7, source={}, alias=None)
    description = client.get("/openapi.json").json()
    example = description["paths"]["/v1/responses"]["post"]["requestBody"]["content"]["text/plain"]["example"]
    v1 = "/v1/models/{model}"
    node = client.get("/v1/models/tiny/concepts").json()["concepts"][0]["id"]
    name = f"/v1/models/tiny/concepts/{node}/name"
    files = [("cloud", ("box.xyz", example)), ("cloud", ("torn.ply", b"ply\n"))]
    schedule = {"name": "weekly", "cron": "0 3 * * mon", "job": {"name": "tiny", "simulate": 2}}
    detail = {"detail": ["responses,stimuli", "explanation", "segments"]}
    asked = {
        "post /v1/responses": client.post("/v1/responses", content=example, params=detail),
        "post /v1/responses/batch": client.post("/v1/responses/batch", files=files, params={"detail": "concepts"}),
        "get /v1/models": client.get("/v1/models"),
        "get /v1/models/{name}/versions/{version}": client.get("/v1/models/tiny/versions/1"),
        f"put {v1}/concepts/{{concept}}/name": client.put(name, json={"name": "box"}),
        f"post {v1}/names/propose": client.post(
            "/v1/models/tiny/names/propose", files=files, data={"label": ["box", "mug"]}
        ),
        **{f"get {v1}{path}": client.get(f"/v1/models/tiny{path}") for path in ("", *HELD)},
        f"get {v1}/concepts/{{concept}}/name": client.get(name),
        f"delete {v1}/concepts/{{concept}}/name": client.delete(name),
        "get /v1/models/{name}/aliases": client.get("/v1/models/tiny/aliases"),
        f"post {v1}/promote": client.post("/v1/models/tiny:2/promote"),
        "post /v1/models/{name}/rollback": client.post("/v1/models/tiny/rollback?leaving=2"),
        "get /v1/models/{name}/versions/{version}/compare": client.get(
            "/v1/models/tiny/versions/1/compare", params={"with": "tiny:2"}
        ),
        f"post {v1}/names/carry": client.post("/v1/models/tiny:2/names/carry?from=tiny:1"),
        "post /v1/schedules": client.post("/v1/schedules", json=schedule),
        "get /v1/schedules": client.get("/v1/schedules"),
        "get /v1/schedules/{name}": client.get("/v1/schedules/weekly"),
        "post /v1/schedules/{name}/pause": client.post("/v1/schedules/weekly/pause"),
        "post /v1/schedules/{name}/resume": client.post("/v1/schedules/weekly/resume"),
        "delete /v1/schedules/{name}": client.delete("/v1/schedules/weekly"),
        "post /v1/jobs": client.post(
            "/v1/jobs",
            json={"kind": "train", "name": "tiny", "simulate": 2},
            headers={"Idempotency-Key": "one"},
        ),
        "get /v1/jobs": client.get("/v1/jobs"),
        "get /v1/jobs/{job}": client.get("/v1/jobs/one"),
        "post /v1/jobs/{job}/cancel": client.post("/v1/jobs/one/cancel"),
        "post /v1/jobs/{job}/retry": client.post("/v1/jobs/one/retry"),
        "get /v1/jobs/{job}/logs": client.get("/v1/jobs/one/logs"),
        **asked_of_datasets(client, example),
        "get /v1/streams": client.get("/v1/streams"),
        "get /healthz": client.get("/healthz"),
        "get /readyz": client.get("/readyz"),
    }
    for operation, status, content in contents(description):
        if status < "300" and "report" not in operation:
            assert asked[operation].status_code == int(status), asked[operation].text
            schema = {**content.get("schema", {}), "components": description["components"]}
            jsonschema.validate(asked[operation].json(), schema)


def logged(caplog: pytest.LogCaptureFixture, word: str) -> list[str]:
    """Lines of the interface's log that have a word; they are written when the answer is sent."""
    began = time.monotonic()
    while time.monotonic() - began < 5:
        records = [record for record in caplog.records if record.name.startswith("service.transports")]
        if lines := [record.message for record in records if word in record.message]:
            return lines
        time.sleep(0.01)
    raise AssertionError(f"nothing logged with {word}")


class TestRequestIds:
    UUID = "7f1c3bd2-5b39-4cb8-a5a8-6f0c2f1e9d10"

    @pytest.mark.parametrize("given", [UUID, "robot-7.42", "01J9ZK3V5T8Y2M4N6P7Q8R9S0T"])
    def test_the_clients_own_is_in_the_answer_the_problem_and_the_log(
        self, client: httpx.Client, caplog: pytest.LogCaptureFixture, given: str
    ) -> None:
        with caplog.at_level(logging.DEBUG):
            response = client.post("/v1/responses", content=b"", headers={"x-request-id": given})
            assert logged(caplog, given)[0].endswith("ms")
        assert response.headers["x-request-id"] == given
        assert response.json()["instance"].endswith(f":{given}")
        assert response.json()["instance"].startswith("urn:uuid:" if given == self.UUID else "urn:shape-concepts:")
        assert client.get("/healthz", headers={"x-request-id": given}).headers["x-request-id"] == given

    @pytest.mark.parametrize("given", ["", "x" * 129, "a b", "-x", "<script>", "a\tb", "ä".encode()])
    def test_what_would_do_harm_in_a_log_is_replaced(self, client: httpx.Client, given: str | bytes) -> None:
        made = client.get("/healthz", headers={"x-request-id": given}).headers["x-request-id"]
        assert re.fullmatch(r"[0-9a-f-]{36}", made)

    def test_a_path_begins_no_line_of_the_log(self, client: httpx.Client, caplog: pytest.LogCaptureFixture) -> None:
        with caplog.at_level(logging.DEBUG):
            client.get("/v1/%0aroot%20logged%20in")
            assert "\n" not in logged(caplog, "root")[0]


def test_a_method_that_is_not_allowed_is_told_all_that_are(client: httpx.Client) -> None:
    for path, allowed in (("/v1/models/tiny/concepts/9/name", "DELETE, GET, PUT"), ("/docs", "GET")):
        refused = client.request("PATCH", path)
        assert (refused.status_code, allowed in refused.headers["allow"]) == (405, True)
