"""What OpenAPI says of the protocol is so."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import httpx
import jsonschema
import numpy as np
import pytest

from service.application import Application
from service.keys import KeyStore
from service.settings import Settings
from service.transports.open_inference import rest
from service.transports.open_inference.description import EXAMPLE
from service.transports.open_inference.signature import OUTPUTS
from tests.service.transports.open_inference.conftest import answering, request_of
from tests.service.transports.open_inference.test_rest import WRONG


@pytest.fixture
def description(client: httpx.Client) -> dict[str, Any]:
    described: dict[str, Any] = client.get("/openapi.json").json()
    return described


def operations(description: dict[str, Any]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    for path, methods in description["paths"].items():
        if path.startswith("/v2"):
            for method, operation in methods.items():
                yield method.upper(), path, operation


def check(document: Any, schema: dict[str, Any], description: dict[str, Any]) -> None:
    jsonschema.validate(document, {**schema, "components": description["components"]})


def schema_of(operation: dict[str, Any], response: httpx.Response) -> dict[str, Any]:
    """The schema of an answer; that there is none for its status is an error."""
    content: dict[str, Any] = operation["responses"][str(response.status_code)]["content"]["application/json"]
    schema: dict[str, Any] = content["schema"]
    return schema


def test_every_route_is_described_beside_all_else(description: dict[str, Any], application: Application) -> None:
    routes = rest.create_app(application).routes
    described = {(method, path) for method, path, _ in operations(description)}
    assert {(method, route.path) for route in routes for method in route.methods - {"HEAD"}} == described  # type: ignore[attr-defined]
    assert "/v1/responses" in description["paths"]
    names = [operation["operationId"] for methods in description["paths"].values() for operation in methods.values()]
    assert len(set(names)) == len(names)


def test_every_example_fits_its_schema_and_every_field_is_described(description: dict[str, Any]) -> None:
    for _, _, operation in operations(description):
        contents = [operation.get("requestBody", {"content": {}}), *operation["responses"].values()]
        for media_type, content in (item for each in contents for item in each["content"].items()):
            if media_type == "application/json":
                check(content["example"], content["schema"], description)
        assert all(parameter["description"] for parameter in operation["parameters"])
    for name, schema in description["components"]["schemas"].items():
        for field, described in schema.get("properties", {}).items():
            assert described.get("description") or "$ref" in described, f"{name}.{field}"


def test_real_answers_fit_the_description(client: httpx.Client, description: dict[str, Any], cloud: np.ndarray) -> None:
    asked = request_of(cloud, outputs=[{"name": name} for name in OUTPUTS])
    for method, path, operation in operations(description):
        for sent in (EXAMPLE, asked) if method == "POST" else (None,):
            response = client.request(method, path.format(model="tiny", version=1), json=sent)
            assert response.status_code == 200, response.text
            check(response.json(), schema_of(operation, response), description)
        if "{model}" in path:
            unknown = client.request(method, path.format(model="mugs", version=1), json=EXAMPLE if sent else None)
            assert unknown.status_code == 404
            check(unknown.json(), schema_of(operation, unknown), description)


def test_what_is_refused_is_described(client: httpx.Client, description: dict[str, Any], cloud: np.ndarray) -> None:
    operation = description["paths"]["/v2/models/{model}/infer"]["post"]
    schema = operation["requestBody"]["content"]["application/json"]["schema"]
    request = {**schema, "components": description["components"]}
    valid = jsonschema.Draft202012Validator(request).is_valid
    assert valid(request_of(cloud))
    told = 0
    for wrong, status, _ in WRONG:
        sent = request_of(cloud, **wrong)
        response = client.post("/v2/models/tiny/infer", content=json.dumps(sent))
        assert response.status_code == status
        check(response.json(), schema_of(operation, response), description)
        told += not valid(sent)
    assert told > len(WRONG) / 2  # most could have been known beforehand
    for headers, status in (({"content-encoding": "zstd"}, 415), ({"content-encoding": "gzip"}, 400)):
        response = client.post("/v2/models/tiny/infer", content=b"x", headers=headers)
        assert response.status_code == status
        check(response.json(), schema_of(operation, response), description)


def test_what_needs_a_key_says_so(settings: Settings, description: dict[str, Any]) -> None:
    KeyStore(settings.store).create("a", ("answer",))
    application = Application(settings.model_copy(update={"access": "keys"}))
    with answering(application) as client:
        for method, path, operation in operations(description):
            response = client.request(method, path.format(model="tiny", version=1))
            assert (response.status_code == 401) == bool(operation.get("security")) == ("/health/" not in path)
            check(response.json(), schema_of(operation, response), description)
    application.close()
