"""The interface as a whole: health, errors of the framework, and a description whose examples are true."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import jsonschema
import pytest

from service.application import Application, ModelSummary
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
        ("GET", "/", 404, "not-found"),
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
            def models(self) -> list[ModelSummary]:
                raise RuntimeError("the secret inside")

        application = Faulty(settings)
        yield application
        application.close()

    def test_it_is_logged_whole_and_answered_plainly(
        self, client: httpx.Client, caplog: pytest.LogCaptureFixture
    ) -> None:
        with caplog.at_level(logging.ERROR):
            response = client.get("/v1/models")
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


def contents(description: dict[str, Any]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Operation, status and content of every documented answer."""
    for path, operations in description["paths"].items():
        for method, operation in operations.items():
            for status, answer in operation["responses"].items():
                for media_type, content in answer["content"].items():
                    if media_type != "image/png":
                        assert media_type == ("application/json" if status == "200" else "application/problem+json")
                        yield f"{method} {path}", status, content


def examples_of(content: dict[str, Any]) -> list[dict[str, Any]]:
    return [content["example"]] if "example" in content else [e["value"] for e in content["examples"].values()]


def test_every_answer_is_described_with_an_example_that_fits_its_schema(client: httpx.Client) -> None:
    description = client.get("/openapi.json").json()
    seen = set()
    for operation, status, content in contents(description):
        seen.add((operation, status))
        for example in examples_of(content):
            jsonschema.validate(example, {**content["schema"], "components": description["components"]})
            if status != "200":
                assert example["status"] == int(status)
    for status in ("200", "400", "404", "408", "413", "415", "422", "429", "500", "503"):
        assert ("post /v1/responses", status) in seen
    assert {operation for operation, _ in seen} == {
        "post /v1/responses",
        "get /v1/models",
        "get /v1/models/{name}/versions/{version}",
        "get /v1/models/{name}/versions/{version}/objects/{number}.png",
        "get /healthz",
        "get /readyz",
    }


def test_the_clouds_that_are_shown_fit_their_schemas(client: httpx.Client) -> None:
    body = client.get("/openapi.json").json()["paths"]["/v1/responses"]["post"]["requestBody"]["content"]
    shown = {media_type for media_type, content in body.items() if "example" in content}
    assert shown == {"text/plain", "application/json"}
    for media_type in shown:
        jsonschema.validate(body[media_type]["example"], body[media_type]["schema"])
    for wrong in ({}, {"points": [[1, 2]]}, [1, 2, 3], {"points": [], "unit": "mile"}, {"points": [], "x": 1}):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(wrong, body["application/json"]["schema"])


def test_every_field_and_parameter_is_described(client: httpx.Client) -> None:
    description = client.get("/openapi.json").json()
    told = ("Explanation", "SeenSegment", "FiredVertex", "NearConcept", "Likeness")
    for name in ("Answer", "Concept", "Stimuli", "Manifest", "Problem", "Readiness", "ModelSummary", *told):
        for field, schema in description["components"]["schemas"][name]["properties"].items():
            assert schema.get("description"), f"{name}.{field}"
    for operations in description["paths"].values():
        for operation in operations.values():
            for parameter in operation.get("parameters", []):
                assert parameter["description"], parameter["name"]


def test_real_answers_fit_the_description(client: httpx.Client) -> None:
    description = client.get("/openapi.json").json()
    example = description["paths"]["/v1/responses"]["post"]["requestBody"]["content"]["text/plain"]["example"]
    asked = {
        "post /v1/responses": client.post(
            "/v1/responses", content=example, params={"stimuli": True, "explain": True, "segments": True}
        ),
        "get /v1/models": client.get("/v1/models"),
        "get /v1/models/{name}/versions/{version}": client.get("/v1/models/tiny/versions/1"),
        "get /healthz": client.get("/healthz"),
        "get /readyz": client.get("/readyz"),
    }
    for operation, status, content in contents(description):
        if status == "200":
            assert asked[operation].status_code == 200
            schema = {**content["schema"], "components": description["components"]}
            jsonschema.validate(asked[operation].json(), schema)
