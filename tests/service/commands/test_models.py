"""Models on the command line: listed, shown, compared, promoted, written out."""

from __future__ import annotations

import json
from pathlib import Path

from service.engine.model import ShapeModel
from service.model_file import encode
from service.store import ModelStore
from tests.service.commands.asked import lines, run


def test_versions_are_compared(folder: Path, store: ModelStore, model: ShapeModel) -> None:
    store.publish(model, name="tiny", seed=7, source={}, alias="staging")
    (told,) = lines(run("models", "compare", "tiny", "tiny@staging", "--json"))
    assert [(told[which]["model"], told[which]["version"]) for which in ("old", "new")] == [("tiny", 1), ("tiny", 2)]
    assert told["fates"] == {"persists": len(model.concepts().ids)}
    shown = run("models", "compare", "tiny:1", "tiny:2")
    assert shown.exit_code == 0
    assert "persists" in shown.stdout
    assert run("models", "compare", "tiny:1", "tiny:3").exit_code == 1


def test_models_can_be_listed_shown_promoted_and_rolled_back(
    folder: Path, store: ModelStore, model: ShapeModel
) -> None:
    store.publish(model, name="tiny", seed=7, source={}, alias=None)
    assert lines(run("models", "list", "--json")) == [
        {"models": [{"name": "tiny", "versions": [1, 2], "aliases": {"production": 1}, "built_in": False}]}
    ]
    assert lines(run("models", "promote", "tiny:2", "--json")) == [
        {"model": "tiny", "version": 2, "alias": "production"}
    ]
    (shown,) = lines(run("models", "show", "tiny", "--json"))
    assert (shown["version"], shown["seed"]) == (2, 7)
    assert [entry["version"] for entry in shown["aliases"]["production"]] == [1, 2]
    assert lines(run("models", "rollback", "tiny", "--json"))[0]["version"] == 1
    assert lines(run("models", "promote", "tiny:2", "--alias", "staging", "--json"))[0]["alias"] == "staging"
    assert lines(run("models", "promote", "tiny@staging", "--json"))[0]["version"] == 2
    for command in (["list"], ["show", "tiny"]):
        result = run("models", *command)
        assert result.exit_code == 0
        assert "tiny" in result.stdout


def test_an_export_is_the_stored_model(folder: Path, store: ModelStore, model: ShapeModel) -> None:
    (result,) = lines(run("models", "export", "tiny", "--out", "deep/exported", "--json"))
    assert result["files"] == ["deep/exported/manifest.json", "deep/exported/model.safetensors"]
    assert Path("deep/exported/model.safetensors").read_bytes() == encode(model)
    assert json.loads(Path("deep/exported/manifest.json").read_text())["name"] == "tiny"
