"""Names of concepts on the command line."""

from __future__ import annotations

from pathlib import Path

import pytest

from service.engine.model import ShapeModel
from service.store import ModelStore
from tests.service.commands.asked import lines, run


class TestNames:
    def test_a_name_is_given_listed_told_and_taken_away(self, folder: Path, model: ShapeModel) -> None:
        concept = int(model.concepts().ids[0])
        (given,) = lines(run("names", "set", "tiny", str(concept), " tea mug ", "--json"))
        assert given == {"model": "tiny", "version": 1, "concept": concept, "name": "tea mug"}
        assert "tea mug" in run("names", "list", "tiny").stdout
        (listed,) = lines(run("names", "list", "tiny:1", "--json"))
        assert listed["names"] == [{"concept": concept, "name": "tea mug", "carried_from": None}]
        (answer,) = lines(run("respond", "--json", "good.ply"))
        assert {c["id"]: c["name"] for c in answer["concepts"]}[concept] == "tea mug"
        assert f"Concept {concept} of tiny:1 has no name now" in run("names", "remove", "tiny", str(concept)).stdout
        assert lines(run("names", "list", "tiny", "--json"))[0]["names"] == []

    def test_names_are_carried_over_once_and_say_so(self, folder: Path, store: ModelStore, model: ShapeModel) -> None:
        store.publish(model, name="tiny", seed=7, source={}, alias="staging")
        concept = int(model.concepts().ids[0])
        run("names", "set", "tiny:1", str(concept), "mug")
        for _ in range(2):
            (carried,) = lines(run("names", "carry", "tiny:2", "--from", "tiny:1", "--json"))
            assert (carried["version"], carried["carried_from"]) == (2, "tiny:1")
            assert carried["names"] == [{"concept": concept, "name": "mug", "before": concept, "jaccard": 1}]
        assert "mug" in run("names", "carry", "tiny@staging", "--from", "tiny").stdout
        assert "tiny:1" in run("names", "list", "tiny:2").stdout
        assert "say another version" in run("names", "carry", "tiny:1", "--from", "tiny").stderr

    def test_names_are_proposed_from_labels_and_given_when_asked(self, folder: Path) -> None:
        (folder / "labels.csv").write_text("file,category\ngood.ply,mug\nbad.ply,bowl\nnowhere.ply,bowl\n")
        result = run("names", "propose", "tiny", "--labels", "labels.csv", "--json")
        assert result.exit_code == 1
        (proposed,) = lines(result)
        assert [entry["name"] for entry in proposed["proposals"]] == ["mug"]
        assert [entry["file"] for entry in proposed["left_out"]] == ["bad.ply", "nowhere.ply"]
        assert lines(run("names", "list", "tiny", "--json"))[0]["names"] == []
        (folder / "labels.csv").write_text("file,category,fine\ngood.ply,mug,x\n")
        result = run("names", "propose", "tiny", "--labels", "labels.csv", "--apply")
        assert (result.exit_code, "mug 1" in result.stdout) == (0, True)
        assert [entry["name"] for entry in lines(run("names", "list", "tiny", "--json"))[0]["names"]] == ["mug"]

    @pytest.mark.parametrize(
        ("arguments", "code", "said"),
        [
            (["set", "tiny", "3", "mug"], 1, "no concept 3"),
            (["set", "tiny", "14", "a\tb"], 1, "visible characters"),
            (["set", "nobody", "14", "mug"], 1, "nobody"),
            (["set", "tiny", "x", "mug"], 2, "CONCEPT"),
            (["propose", "tiny", "--labels", "good.ply"], 1, "good.ply"),
            (["propose", "tiny", "--labels", "bad.ply"], 1, "columns file and category"),
            (["propose", "tiny", "--labels", "nowhere.csv"], 1, "nowhere.csv"),
        ],
    )
    def test_what_is_wrong_is_said(self, folder: Path, arguments: list[str], code: int, said: str) -> None:
        result = run("names", *arguments)
        assert (result.exit_code, said in result.stderr) == (code, True), result.stderr
