"""GET /v1/models and the manifests."""

from __future__ import annotations

import httpx

from service.application import Application
from service.engine.model import ShapeModel
from service.model_file import Manifest


def test_models_are_listed_with_versions_and_aliases(
    client: httpx.Client, application: Application, model: ShapeModel
) -> None:
    application.store.publish(model, name="tiny", seed=7, source={}, alias="staging")
    assert client.get("/v1/models").json() == {
        "models": [{"name": "tiny", "versions": [1, 2], "aliases": {"production": 1, "staging": 2}}]
    }


def test_a_manifest_is_that_of_the_store(client: httpx.Client, application: Application) -> None:
    found = client.get("/v1/models/tiny/versions/1")
    assert Manifest.model_validate_json(found.content) == application.manifest("tiny", 1)


def test_an_unknown_version_says_which_there_are(client: httpx.Client) -> None:
    response = client.get("/v1/models/tiny/versions/2")
    assert response.status_code == 404
    assert "the versions 1" in response.json()["detail"]
    assert client.get("/v1/models/nobody/versions/1").status_code == 404
    assert client.get("/v1/models/Tiny/versions/1").status_code == 422
    assert client.get("/v1/models/tiny/versions/x").status_code == 422
