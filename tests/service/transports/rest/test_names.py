"""Names of concepts, over HTTP: given, told by every replica, taken away, and proposed from labelled clouds."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import httpx
import pytest

from service.application import Application
from service.clouds import write_ply
from service.engine.cloud import PointCloud
from service.engine.model import ShapeModel
from service.settings import Settings


@pytest.fixture
def concept(model: ShapeModel) -> int:
    """The largest concept."""
    return int(model.concepts().ids[0])


def told(client: httpx.Client, cloud: PointCloud) -> dict[int, str | None]:
    answer = client.post("/v1/responses", content=write_ply(cloud)).json()
    return {concept["id"]: concept["name"] for concept in answer["concepts"]}


def test_a_name_is_in_answers_and_listings_until_it_is_taken_away(
    client: httpx.Client, clouds: list[PointCloud], concept: int
) -> None:
    path = f"/v1/models/tiny/concepts/{concept}/name"
    assert set(told(client, clouds[0]).values()) == {None}
    for _ in range(2):
        given = client.put(path, json={"name": " Teetasse "})
        assert given.json() == {"model": "tiny", "version": 1, "concept": concept, "name": "Teetasse"}
    assert told(client, clouds[0])[concept] == "Teetasse"
    listed = client.get("/v1/models/tiny/concepts").json()["concepts"]
    assert {entry["id"]: entry["name"] for entry in listed if entry["name"]} == {concept: "Teetasse"}
    assert client.get("/v1/models/tiny/names").json()["names"] == [
        {"concept": concept, "name": "Teetasse", "carried_from": None}
    ]
    for _ in range(2):
        assert client.delete(path).json()["name"] is None
    assert told(client, clouds[0])[concept] is None
    history = client.get(path).json()
    assert (history["name"], [entry["name"] for entry in history["history"]]) == (None, ["Teetasse", None])


def test_every_concept_of_every_time_can_be_named_and_nothing_else(client: httpx.Client, model: ShapeModel) -> None:
    nodes = {int(node) for time in model.filtration.time for node in model.concepts(time).ids}
    for node in range(2 * len(model.filtration.time) + 3):
        named = client.put(f"/v1/models/tiny/concepts/{node}/name", json={"name": f"thing {node}"})
        assert named.status_code == (200 if node in nodes else 404)
    assert {entry["concept"] for entry in client.get("/v1/models/tiny/names").json()["names"]} == nodes


def test_names_are_carried_over_to_concepts_that_nobody_named(
    client: httpx.Client, application: Application, model: ShapeModel, concept: int
) -> None:
    application.store.publish(model, name="tiny", seed=7, source={}, alias=None)
    other = int(model.spectrum().ids[1])
    for version, id, name in ((1, concept, "mug"), (1, other, "bowl"), (2, other, "dish")):
        client.put(f"/v1/models/tiny:{version}/concepts/{id}/name", json={"name": name})
    for _ in range(2):
        carried = client.post("/v1/models/tiny:2/names/carry", params={"from": "tiny:1"})
        assert carried.json() == {
            "model": "tiny",
            "version": 2,
            "carried_from": "tiny:1",
            "names": [{"concept": concept, "name": "mug", "before": concept, "jaccard": 1}],
        }
    listed = {entry["concept"]: entry for entry in client.get("/v1/models/tiny:2/names").json()["names"]}
    assert listed == {
        concept: {"concept": concept, "name": "mug", "carried_from": "tiny:1"},
        other: {"concept": other, "name": "dish", "carried_from": None},
    }
    history = client.get(f"/v1/models/tiny:2/concepts/{concept}/name").json()["history"]
    assert [(entry["name"], entry["carried_from"]) for entry in history] == [("mug", "tiny:1")]


@pytest.mark.parametrize(
    ("target", "query", "status"),
    [("tiny", "?from=tiny:1", 422), ("tiny", "", 422), ("tiny", "?from=Tiny", 422), ("tiny", "?from=tiny:9", 404)],
)
def test_names_that_cannot_be_carried_over_are_a_problem(
    client: httpx.Client, target: str, query: str, status: int
) -> None:
    refused = client.post(f"/v1/models/{target}/names/carry{query}")
    assert (refused.status_code, refused.json()["status"]) == (status, status), refused.text


def test_names_belong_to_one_version(
    client: httpx.Client, application: Application, model: ShapeModel, concept: int
) -> None:
    application.store.publish(model, name="tiny", seed=7, source={})
    assert client.put(f"/v1/models/tiny:2/concepts/{concept}/name", json={"name": "mug"}).json()["version"] == 2
    assert client.get("/v1/models/tiny:1/names").json()["names"] == []


class TestAnotherReplica:
    @pytest.fixture
    def other(self, application: Application) -> Iterator[Application]:
        other = Application(application.settings)
        yield other
        other.close()

    def test_it_tells_a_name_within_seconds(
        self, client: httpx.Client, other: Application, clouds: list[PointCloud], concept: int
    ) -> None:
        assert {entry.name for entry in other.respond(clouds[0]).concepts} == {None}
        client.put(f"/v1/models/tiny/concepts/{concept}/name", json={"name": "mug"})
        began = time.monotonic()
        while {entry.id: entry.name for entry in other.respond(clouds[0]).concepts}[concept] != "mug":
            assert time.monotonic() - began < 3


JSON = {"content-type": "application/json"}
REFUSED: list[tuple[str, int, str, dict[str, Any]]] = [
    ("no body", 415, "unsupported-format", {}),
    ("no JSON", 400, "unreadable-body", {"content": b"{", "headers": JSON}),
    ("deep JSON", 400, "unreadable-body", {"content": b"[" * 9999, "headers": JSON}),
    ("a list", 422, "invalid-parameter", {"json": ["mug"]}),
    ("no name", 422, "invalid-parameter", {"json": {}}),
    ("a number", 422, "invalid-parameter", {"json": {"name": 7}}),
    ("nothing", 422, "invalid-parameter", {"json": {"name": None}}),
    ("an empty name", 422, "invalid-parameter", {"json": {"name": ""}}),
    ("blanks", 422, "invalid-parameter", {"json": {"name": "  "}}),
    ("a line break", 422, "invalid-parameter", {"json": {"name": "a\nb"}}),
    ("a long name", 422, "invalid-parameter", {"json": {"name": "x" * 101}}),
    ("half a letter", 400, "unreadable-body", {"content": b'{"name": "\\ud800"}', "headers": JSON}),
    ("another member", 422, "invalid-parameter", {"json": {"name": "mug", "colour": "red"}}),
    ("a large body", 413, "content-too-large", {"json": {"name": "x" * 20_000}}),
]  # fmt: skip


@pytest.mark.parametrize(("status", "kind", "request_"), [r[1:] for r in REFUSED], ids=[r[0] for r in REFUSED])
def test_what_is_no_name_is_refused(
    client: httpx.Client, concept: int, status: int, kind: str, request_: dict[str, Any]
) -> None:
    refused = client.put(f"/v1/models/tiny/concepts/{concept}/name", **request_)
    assert (refused.status_code, refused.json()["type"]) == (status, f"urn:shape-concepts:error:{kind}"), refused.text
    assert client.get("/v1/models/tiny/names").json()["names"] == []


class TestProposals:
    @pytest.fixture
    def settings(self, settings: Settings) -> Settings:
        return settings.model_copy(update={"max_body": 2**24})

    def ask(self, client: httpx.Client, clouds: list[bytes], labels: list[str], **params: Any) -> httpx.Response:
        files = [("cloud", (f"{number}.ply", cloud)) for number, cloud in enumerate(clouds)]
        return client.post("/v1/models/tiny/names/propose", files=files, data={"label": labels}, params=params)

    def test_each_concept_is_proposed_the_label_of_most_clouds_that_it_is_the_best_of(
        self, client: httpx.Client, application: Application, clouds: list[PointCloud]
    ) -> None:
        best = [application.respond(cloud, top=1).concepts[0].id for cloud in clouds]
        proposed = self.ask(client, [write_ply(cloud) for cloud in clouds], [f"kind {node}" for node in best]).json()
        assert (proposed["model"], proposed["version"], proposed["applied"]) == ("tiny", 1, False)
        assert {entry["concept"]: entry["name"] for entry in proposed["proposals"]} == {n: f"kind {n}" for n in best}
        assert {entry["concept"]: entry["support"] for entry in proposed["proposals"]} == {
            n: best.count(n) for n in best
        }
        assert all(entry["share"] == 1 for entry in proposed["proposals"])
        assert client.get("/v1/models/tiny/names").json()["names"] == []

    def test_nothing_is_stored_unless_it_is_asked_for_and_ties_never(
        self, client: httpx.Client, clouds: list[PointCloud]
    ) -> None:
        ply = write_ply(clouds[0])
        tie = self.ask(client, [ply, ply], ["mug", "can"], apply=True).json()
        assert [(entry["name"], entry["tied"]) for entry in tie["proposals"]] == [(None, ["can", "mug"])]
        assert client.get("/v1/models/tiny/names").json()["names"] == []
        given = self.ask(client, [ply, ply, ply], ["mug", "can", "mug"], apply=True).json()
        (entry,) = given["proposals"]
        assert (entry["name"], entry["share"], entry["labels"]) == ("mug", 2 / 3, {"mug": 2, "can": 1})
        named = client.get("/v1/models/tiny/names").json()["names"]
        assert named == [{"concept": entry["concept"], "name": "mug", "carried_from": None}]

    def test_a_cloud_that_cannot_be_answered_has_no_say(self, client: httpx.Client, clouds: list[PointCloud]) -> None:
        proposed = self.ask(client, [b"ply\n", write_ply(clouds[0])], ["bowl", "mug"]).json()
        assert [entry["labels"] for entry in proposed["proposals"]] == [{"mug": 1}]
        assert [(entry["file"], entry["label"]) for entry in proposed["left_out"]] == [("0.ply", "bowl")]
        assert proposed["left_out"][0]["problem"]["type"].endswith("unreadable-cloud")

    def test_labels_and_clouds_must_match_and_labels_be_names(self, client: httpx.Client) -> None:
        for labels, status in ((["mug"], 400), (["mug", "can", "bowl"], 400), (["mug", "a\tb"], 422)):
            assert self.ask(client, [b"1", b"2"], labels).status_code == status
        assert client.post("/v1/models/tiny/names/propose", json=[]).status_code == 415
        assert self.ask(client, [b"1"] * 65, ["mug"] * 65).status_code == 413
