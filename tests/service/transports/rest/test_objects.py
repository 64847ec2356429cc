"""Training objects in one picture, and what people say that they are."""

from __future__ import annotations

import dataclasses
import io

import httpx
import numpy as np
import pytest
from PIL import Image

from service.application import Application
from service.clouds import write_ply
from service.engine.cloud import PointCloud
from service.engine.model import ShapeModel
from service.labels import Label


def test_training_objects_stand_side_by_side_in_the_order_asked_for(client: httpx.Client, model: ShapeModel) -> None:
    picture = client.get("/v1/models/tiny/versions/1/objects.png", params={"number": [5, 0, 5]})
    assert (picture.status_code, picture.headers["content-type"]) == (200, "image/png")
    tiles = np.split(np.asarray(Image.open(io.BytesIO(picture.content))), 3, axis=1)
    for number, tile in zip((5, 0, 5), tiles, strict=True):
        assert np.array_equal(tile, model.prototypes.thumbnails[number])


@pytest.mark.parametrize(
    ("path", "numbers", "status"),
    [
        ("tiny/versions/1", [8], 422),
        ("tiny/versions/1", [], 422),
        ("tiny/versions/1", ["x"], 422),
        ("tiny/versions/1", [0] * 257, 422),
        ("tiny/versions/2", [0], 404),
    ],
)
def test_a_picture_that_cannot_be_is_refused(client: httpx.Client, path: str, numbers: list[int], status: int) -> None:
    refused = client.get(f"/v1/models/{path}/objects.png", params={"number": numbers})
    assert (refused.status_code, refused.headers["content-type"]) == (status, "application/problem+json")


def test_objects_of_labelled_datasets_have_categories_and_others_none(
    client: httpx.Client, application: Application, model: ShapeModel, clouds: list[PointCloud]
) -> None:
    datasets = application.datasets.store
    for name in ("kitchen", "shed"):
        datasets.create(name)
        for number in range(2):
            datasets.add(name, f"{number}.ply", write_ply(clouds[number]))
    datasets.label("kitchen", {"0.ply": Label(category="mug"), "1.ply": Label(category="bowl")})
    keys = ("kitchen/0.ply", "shed/0.ply", "kitchen/1.ply", "other/0.ply", *map(str, range(4)))
    taught = dataclasses.replace(model, prototypes=dataclasses.replace(model.prototypes, cloud_keys=keys))
    parts = [{"kind": "dataset", "name": name, "clouds": 2} for name in ("kitchen", "shed", "long-gone")]
    source = {"kind": "joined", "clouds": 8, "parts": [*parts, {"kind": "simulation", "clouds": 4, "seed": 7}]}
    application.store.publish(taught, name="home", seed=7, source=source)
    answer = client.get("/v1/models/home/labels")
    assert answer.json() == {
        "model": "home",
        "version": 1,
        "labelled": 2,
        "categories": ["mug", None, "bowl", None, None, None, None, None],
    }
    unchanged = client.get("/v1/models/home/labels", headers={"If-None-Match": answer.headers["etag"]})
    assert unchanged.status_code == 304
    datasets.label("shed", {"0.ply": Label(category="spade")})
    assert client.get("/v1/models/home/labels").json()["labelled"] == 3


def test_a_model_of_simulated_objects_has_no_labels(client: httpx.Client) -> None:
    assert client.get("/v1/models/tiny/labels").json()["labelled"] == 0
    assert client.get("/v1/models/nobody/labels").status_code == 404
