"""/v1/models: what there is, how it was made, what it holds, and what aliases mean."""

from __future__ import annotations

import io

import httpx
import numpy as np
import pytest
from PIL import Image

from service.application import Application
from service.clouds import write_ply
from service.comparing import VersionComparison
from service.engine.cloud import PointCloud
from service.engine.model import ShapeModel
from service.model_file import Manifest
from tests.learnt import learnt
from tests.service.versions import grown


def test_models_are_listed_with_versions_and_aliases(
    client: httpx.Client, application: Application, model: ShapeModel
) -> None:
    application.store.publish(model, name="tiny", seed=7, source={}, alias="staging")
    assert client.get("/v1/models").json() == {
        "models": [{"name": "tiny", "versions": [1, 2], "aliases": {"production": 1, "staging": 2}, "built_in": False}]
    }


def test_a_manifest_is_that_of_the_store(client: httpx.Client, application: Application) -> None:
    found = client.get("/v1/models/tiny/versions/1")
    assert Manifest.model_validate_json(found.content) == application.models.manifest("tiny", 1)


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


class TestWhatAModelHolds:
    """The listing of its concepts, its barcode, annexation graph and tree are those of the model."""

    @pytest.mark.parametrize("reference", ["tiny", "tiny:1", "tiny@production"])
    def test_its_concepts_are_those_that_answers_compare_clouds_with(
        self, client: httpx.Client, model: ShapeModel, clouds: list[PointCloud], reference: str
    ) -> None:
        listed = client.get(f"/v1/models/{reference}/concepts").json()
        answer = client.post("/v1/responses", content=write_ply(clouds[0])).json()
        assert (listed["model"], listed["version"], listed["time"]) == ("tiny", 1, answer["time"])
        assert len(listed["concepts"]) == len(answer["responses"])
        known = {concept["id"]: concept for concept in listed["concepts"]}
        for concept in answer["concepts"]:
            assert {key: concept[key] for key in ("id", "name", "prototypes", "time")} == {
                key: known[concept["id"]][key] for key in ("id", "name", "prototypes", "time")
            }
            assert answer["responses"][list(known).index(concept["id"])] == concept["response"]

    @pytest.mark.parametrize("time", [0, 0.5, 0.8, 1])
    def test_its_concepts_at_a_time_are_the_components_of_the_annexation_graph(
        self, client: httpx.Client, time: float
    ) -> None:
        listed = client.get("/v1/models/tiny/concepts", params={"time": time}).json()
        graph = client.get("/v1/models/tiny/annexations").json()
        components = {number: {number} for number in range(len(listed["objects"]))}
        for (annexed, annexing), at in zip(graph["edges"], graph["time"], strict=True):
            if at <= time:
                components[annexing] |= components[annexed]
                for number in components[annexing]:
                    components[number] = components[annexing]
        expected = {tuple(sorted(members)) for members in components.values() if len(members) > 1}
        assert {tuple(concept["objects"]) for concept in listed["concepts"]} == expected
        for concept in listed["concepts"]:
            assert concept["prototypes"] == len(concept["objects"])
            assert concept["time"] == listed["time"] == time

    def test_its_training_objects_can_be_told_and_shown(self, client: httpx.Client, model: ShapeModel) -> None:
        listed = client.get("/v1/models/tiny/concepts").json()
        for number, told in enumerate(listed["objects"]):
            assert told == {
                "object": number,
                "key": model.prototypes.cloud_keys[number],
                "hash": model.prototypes.cloud_hashes[number],
                "map": model.prototypes.map[number].tolist(),
            }
            picture = client.get(listed["thumbnails"].replace("{object}", str(number)))
            assert picture.headers["content-type"] == "image/png"

    def test_bars_die_when_components_are_annexed_and_one_never(self, client: httpx.Client) -> None:
        bars = client.get("/v1/models/tiny/barcode").json()["bars"]
        graph = client.get("/v1/models/tiny/annexations").json()
        assert [birth for birth, _ in bars] == [0] * 8
        assert [death for _, death in bars] == [*sorted(graph["time"]), None]
        assert sorted(graph["order"]) == list(range(7))
        assert graph["moments"] == sorted(set(graph["time"]))
        assert graph["annexations"] == [graph["time"].count(moment) for moment in graph["moments"]]

    def test_its_tree_spans_all_objects_and_its_rows_are_those_of_the_annexations(
        self, client: httpx.Client, model: ShapeModel
    ) -> None:
        tree = client.get("/v1/models/tiny/tree").json()
        graph = client.get("/v1/models/tiny/annexations").json()
        assert tree["edges"] == sorted(tree["edges"]) == model.space.edges.tolist()
        assert {number for edge in tree["edges"] for number in edge} == set(range(8))
        assert tree["distance"] == model.space.distance.tolist()
        assert tree["vertex_heat"] == model.space.vertex_heat.tolist()
        assert len(tree["edges"]) == len(graph["edges"])
        assert tree["epsilon_max"] == graph["epsilon_max"] == model.filtration.epsilon_max


class TestAliases:
    def test_promoting_moves_an_alias_once_and_rolling_back_too(
        self, client: httpx.Client, application: Application, model: ShapeModel
    ) -> None:
        application.store.publish(model, name="tiny", seed=7, source={}, alias="staging")
        for reference in ("tiny:2", "tiny:2", "tiny@staging"):
            moved = client.post(f"/v1/models/{reference}/promote")
            assert moved.json() == {"model": "tiny", "alias": "production", "version": 2}
        assert client.get("/v1/models/tiny").json()["version"] == 2
        for _ in range(3):
            back = client.post("/v1/models/tiny/rollback", params={"leaving": 2})
            assert back.json() == {"model": "tiny", "alias": "production", "version": 1}
        history = client.get("/v1/models/tiny/aliases").json()
        assert [(entry["version"], entry["action"]) for entry in history["aliases"]["production"]] == [
            (1, "promote"),
            (2, "promote"),
            (1, "rollback"),
        ]
        assert [entry["version"] for entry in history["aliases"]["staging"]] == [2]

    def test_a_model_without_production_can_be_looked_at(
        self, client: httpx.Client, application: Application, model: ShapeModel
    ) -> None:
        application.store.publish(model, name="other", seed=7, source={}, alias="staging")
        expected = {"name": "other", "versions": [1], "aliases": {"staging": 1}, "built_in": False}
        assert client.get("/v1/models/other").json() == expected | {"version": None}
        assert client.get("/v1/models/other@staging").json() == expected | {"version": 1}
        assert client.get("/v1/models/other@production").status_code == 404

    @pytest.mark.parametrize(
        ("method", "path", "status"),
        [
            ("POST", "/v1/models/tiny/promote", 422),
            ("POST", "/v1/models/tiny:2/promote", 404),
            ("POST", "/v1/models/tiny:1/promote?alias=No", 422),
            ("POST", "/v1/models/tiny/rollback", 422),
            ("POST", "/v1/models/tiny/rollback?leaving=1", 422),
            ("POST", "/v1/models/tiny/rollback?leaving=1&alias=nobody", 404),
            ("POST", "/v1/models/nobody/rollback?leaving=1", 404),
            ("GET", "/v1/models/nobody/aliases", 404),
            ("GET", "/v1/models/nobody", 404),
            ("GET", "/v1/models/tiny:2", 404),
            ("GET", "/v1/models/tiny@", 422),
            ("GET", "/v1/models/tiny@nobody/concepts", 404),
            ("GET", "/v1/models/tiny:9/barcode", 404),
            ("GET", "/v1/models/Tiny/tree", 422),
            ("DELETE", "/v1/models/tiny/tree", 405),
            ("GET", "/v1/models/tiny/concepts?time=2", 422),
            ("GET", "/v1/models/tiny/annexations?time=1", 422),
        ],
    )
    def test_what_is_not_there_is_a_problem(self, client: httpx.Client, method: str, path: str, status: int) -> None:
        refused = client.request(method, path)
        assert (refused.status_code, refused.json()["status"]) == (status, status), refused.text


class TestComparison:
    def test_it_is_that_of_the_use_case_until_a_name_changes(
        self, client: httpx.Client, application: Application
    ) -> None:
        application.store.publish(grown(), name="tiny", seed=7, source={}, alias="staging")
        path, query = "/v1/models/tiny/versions/1/compare", {"with": "tiny@staging"}
        told = client.get(path, params=query)
        expected = application.models.compare(("tiny", 1), ("tiny", 2))
        assert VersionComparison.model_validate_json(told.content) == expected
        assert (expected.asked, expected.new.version) == (8 + 24, 2)
        kept = {"if-none-match": told.headers["etag"]}
        assert client.get(path, params=query, headers=kept).status_code == 304
        client.put(f"/v1/models/tiny:1/concepts/{expected.old_concepts[0].id}/name", json={"name": "mug"})
        again = client.get(path, params=query, headers=kept)
        assert (again.status_code, again.json()["old_concepts"][0]["name"]) == (200, "mug")

    @pytest.mark.parametrize(
        ("path", "status"),
        [
            ("/v1/models/tiny/versions/1/compare", 422),
            ("/v1/models/tiny/versions/1/compare?with=2", 404),
            ("/v1/models/tiny/versions/1/compare?with=Tiny:1", 422),
            ("/v1/models/tiny/versions/1/compare?with=tiny:2", 404),
            ("/v1/models/tiny/versions/2/compare?with=tiny", 404),
            ("/v1/models/tiny/versions/1/compare?with=tiny&without=tiny", 422),
        ],
    )
    def test_what_cannot_be_compared_is_a_problem(self, client: httpx.Client, path: str, status: int) -> None:
        refused = client.get(path)
        assert (refused.status_code, refused.json()["status"]) == (status, status), refused.text

    def test_models_that_have_nothing_in_common_are_a_problem(
        self, client: httpx.Client, application: Application
    ) -> None:
        application.store.publish(learnt("paper"), name="paper", seed=7, source={})
        refused = client.get("/v1/models/tiny/versions/1/compare?with=paper")
        assert (refused.status_code, refused.json()["type"]) == (422, "urn:shape-concepts:error:invalid-parameter")
        assert "no cloud in common" in refused.json()["detail"]


TAGGED = ("", "/versions/1", "/concepts", "/concepts?time=1", "/barcode", "/annexations", "/tree", "/aliases", "/names")


class TestTags:
    @pytest.mark.parametrize("path", TAGGED)
    def test_what_is_still_so_is_not_sent_again(self, client: httpx.Client, path: str) -> None:
        whole = client.get(f"/v1/models/tiny{path}")
        tag = whole.headers["etag"]
        assert (whole.status_code, tag[0], tag[-1]) == (200, '"', '"')
        for held in (tag, f'"x", {tag}', f"W/{tag}", "*"):
            still = client.get(f"/v1/models/tiny{path}", headers={"if-none-match": held})
            assert (still.status_code, still.content, still.headers["etag"]) == (304, b"", tag)
            assert still.headers["cache-control"] == whole.headers["cache-control"]
        assert client.get(f"/v1/models/tiny{path}", headers={"if-none-match": '"x"'}).content == whole.content

    @pytest.mark.parametrize("path", ["/barcode", "/annexations", "/tree"])
    def test_a_version_is_kept_and_an_alias_is_asked_about(
        self, client: httpx.Client, application: Application, model: ShapeModel, path: str
    ) -> None:
        assert "immutable" in client.get(f"/v1/models/tiny:1{path}").headers["cache-control"]
        before = client.get(f"/v1/models/tiny{path}")
        assert before.headers["cache-control"] == "no-cache"
        application.store.publish(model, name="tiny", seed=7, source={}, alias=None)
        client.post("/v1/models/tiny:2/promote")
        after = client.get(f"/v1/models/tiny{path}", headers={"if-none-match": before.headers["etag"]})
        assert (after.status_code, after.json()["version"]) == (200, 2)

    def test_a_name_changes_the_tag_of_the_concepts(self, client: httpx.Client, model: ShapeModel) -> None:
        before = client.get("/v1/models/tiny:1/concepts")
        assert before.headers["cache-control"] == "no-cache"
        client.put(f"/v1/models/tiny/concepts/{model.concepts().ids[0]}/name", json={"name": "mug"})
        after = client.get("/v1/models/tiny:1/concepts", headers={"if-none-match": before.headers["etag"]})
        assert (after.status_code, after.json()["concepts"][0]["name"]) == (200, "mug")
