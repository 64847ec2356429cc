"""Datasets on the command line."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from service.engine.model import ShapeModel
from service.store import ModelStore
from tests.service.commands.asked import lines, run
from tests.service.test_datasets import ply


class TestDatasets:
    @pytest.fixture(autouse=True)
    def mugs(self, folder: Path) -> None:
        """A folder of clouds, and an empty dataset."""
        for seed, file in enumerate(("a.ply", "deep/b.ply", "torn.ply", "notes.md", "sheet.png", ".hidden.ply")):
            (folder / "scans" / file).parent.mkdir(parents=True, exist_ok=True)
            (folder / "scans" / file).write_bytes(ply(seed)[: -9 if file == "torn.ply" else None])
        (folder / "scans" / "labels.csv").write_text("file,category\na.ply,mug\ndeep/b.ply,bowl\n")
        assert run("datasets", "create", "mugs", "--description", "some").exit_code == 0

    def test_a_folder_goes_in_and_an_archive_comes_out_that_makes_the_same_dataset(self) -> None:
        added = run("datasets", "add", "mugs", "scans", "--json")
        assert added.exit_code == 1
        assert {line["key"]: line["outcome"] for line in lines(added)} == {
            "a.ply": "accepted",
            "deep/b.ply": "accepted",
            "torn.ply": "refused",
            "notes.md": "left-out",
            "sheet.png": "left-out",
            ".hidden.ply": "left-out",
            "labels.csv": "accepted",
        }
        again = run("datasets", "add", "mugs", "scans")
        assert "2 already-there" in again.stdout
        assert again.stderr.startswith("Error: torn.ply: ")
        run("datasets", "create", "copy")
        (shown,) = lines(run("datasets", "show", "mugs", "--json"))
        assert [entry["key"] for entry in shown["listed"]] == ["a.ply", "deep/b.ply"]
        for out in ("mugs.zip", "mugs.tar.gz"):
            assert run("datasets", "download", "mugs", "--out", out).exit_code == 0
            assert run("datasets", "add", "copy", out).exit_code == 0
        (copy,) = lines(run("datasets", "show", "copy", "--json"))
        assert [copy[part] for part in ("digest", "categories")] == [shown[part] for part in ("digest", "categories")]
        (listed,) = lines(run("datasets", "list", "--json"))
        assert [held["name"] for held in listed["datasets"]] == ["copy", "mugs"]
        for command in (["list"], ["show", "mugs"], ["show", "mugs", "--limit", "0"]):
            assert "mugs" in run("datasets", *command).stdout

    def test_files_are_added_by_their_names_and_come_back_byte_for_byte(self) -> None:
        assert run("datasets", "add", "mugs", "scans/a.ply", "scans/deep/b.ply").exit_code == 0
        clash = run("datasets", "add", "mugs", "good.ply", "scans/torn.ply", "--json")
        assert [(line["key"], line["outcome"]) for line in lines(clash)] == [
            ("good.ply", "accepted"),
            ("torn.ply", "refused"),
        ]
        shutil.copy("good.ply", "a.ply")
        assert "another cloud 'a.ply'" in run("datasets", "add", "mugs", "a.ply").stderr
        assert "1 replaced" in run("datasets", "add", "mugs", "a.ply", "--replace").stdout
        assert run("datasets", "download", "mugs", "--key", "a.ply", "--out", "back.ply").exit_code == 0
        assert Path("back.ply").read_bytes() == Path("good.ply").read_bytes()

    def test_labels_are_printed_and_taken(self) -> None:
        run("datasets", "add", "mugs", "scans/a.ply")
        Path("more.csv").write_text("file,category\na.ply,cup\nnobody.ply,mug\n")
        taken = run("datasets", "labels", "mugs", "--add", "more.csv", "--json")
        assert (taken.exit_code, "nobody.ply" in taken.stderr) == (1, True)
        assert run("datasets", "labels", "mugs").stdout.splitlines()[1].startswith("a.ply,cup,")
        assert lines(run("datasets", "labels", "mugs", "--json"))[0]["labels"]["a.ply"]["category"] == "cup"

    def test_what_a_model_learnt_from_is_deleted_by_force_only(self, store: ModelStore, model: ShapeModel) -> None:
        run("datasets", "add", "mugs", "scans/a.ply")
        source = {"kind": "dataset", "name": "mugs", "digest": "0", "clouds": 1}
        store.publish(model, name="m", seed=1, source=source)
        refused = run("datasets", "delete", "mugs")
        assert (refused.exit_code, "m:1" in refused.stderr, "--force" in refused.stderr) == (1, True, True)
        assert run("datasets", "delete", "mugs", "--force").exit_code == 0
        assert run("datasets", "show", "mugs").exit_code == 1

    @pytest.mark.parametrize(
        ("arguments", "code", "said"),
        [
            (["create", "Mugs"], 1, "lower-case"),
            (["create", "mugs", "--description", "others"], 1, "some"),
            (["add", "nobody", "scans"], 1, "nobody"),
            (["add", "mugs", "nowhere"], 2, "nowhere"),
            (["add", "mugs", "scans", "--unit", "furlong"], 2, "--unit"),
            (["download", "mugs", "--out", "mugs.rar"], 2, "--out"),
            (["download", "mugs", "--out", "x.ply", "--key", "x"], 1, "no cloud"),
            (["labels", "mugs", "--add", "good.ply"], 1, "comma-separated"),
            (["record", "mugs", "--key", "a/b"], 2, "--connect"),
            (["record", "mugs", "--key", "a//b", "--connect", "tcp/127.0.0.1:1"], 1, "a//b"),
            (["record", "nobody", "--key", "a/b", "--connect", "tcp/127.0.0.1:1"], 1, "nobody"),
            (["record", "mugs", "--key", "a/b", "--connect", "tcp/127.0.0.1:1"], 1, "Unable to connect"),
            (["record", "mugs", "--key", "a/b", "--format", "stl"], 2, "--format"),
        ],
    )
    def test_what_is_wrong_is_said(self, arguments: list[str], code: int, said: str) -> None:
        result = run("datasets", *arguments)
        assert (result.exit_code, said in result.stderr) == (code, True), result.output
        assert "Traceback" not in result.stderr
        assert not list(Path().glob("*.part"))
