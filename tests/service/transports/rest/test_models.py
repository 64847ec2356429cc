"""GET /v1/models and the manifests."""

from __future__ import annotations

import io

import httpx
import numpy as np
from PIL import Image

from service.application import Application
from service.engine.model import ShapeModel
from service.model_file import Manifest


def test_models_are_listed_with_versions_and_aliases(
    client: httpx.Client, application: Application, model: ShapeModel
) -> None:
    application.store.publish(model, name="tiny", seed=7, source={}, alias="staging")
    assert client.get("/v1/models").json() == {
        "models": [{"name": "tiny", "versions": [1, 2], "aliases": {"production": 1, "staging": 2}, "built_in": False}]
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


def test_training_objects_can_be_looked_at(client: httpx.Client, model: ShapeModel) -> None:
    for number, thumbnail in enumerate(model.prototypes.thumbnails):
        response = client.get(f"/v1/models/tiny/versions/1/objects/{number}.png")
        assert (response.status_code, response.headers["content-type"]) == (200, "image/png")
        assert np.array_equal(np.asarray(Image.open(io.BytesIO(response.content))), thumbnail)


def test_an_unknown_training_object_is_told_how_many_there_are(client: httpx.Client) -> None:
    refused = client.get("/v1/models/tiny/versions/1/objects/8.png")
    assert (refused.status_code, refused.json()["type"]) == (422, "urn:shape-concepts:error:invalid-parameter")
    assert "8 objects" in refused.json()["detail"]
    assert client.get("/v1/models/tiny/versions/1/objects/-1.png").status_code == 422
    assert client.get("/v1/models/tiny/versions/1/objects/x.png").status_code == 422
    assert client.get("/v1/models/tiny/versions/2/objects/0.png").status_code == 404
