from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from service.clouds import write_ply
from service.engine.cloud import PointCloud
from service.store import ModelStore
from worker.cli import main


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(main, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("simulated") / "clouds"
    result = run("simulate", "--count", 10, "--seed", 3, "--renderer", "raycast", "--out", folder, "--workers", 1)
    assert result.exit_code == 0, result.output
    return folder


def test_simulate_writes_clouds_the_truth_and_a_contact_sheet(simulated: Path) -> None:
    assert len(list(simulated.glob("*.ply"))) == 10
    assert (simulated / "contact-sheet.png").read_bytes().startswith(b"\x89PNG")
    assert len(json.loads((simulated / "compositions.json").read_text())) > 0


def test_orders_choose_the_objects(tmp_path: Path) -> None:
    chosen = ("--count", 4, "--renderer", "raycast", "--workers", 1, "--out", tmp_path / "two", "--json")
    result = run("simulate", *chosen, "--orders", "1,3")
    assert json.loads(result.stdout)["clouds"] == 4
    assert sorted(f.stem.split("order")[1] for f in (tmp_path / "two").glob("*.ply")) == ["1", "1", "3", "3"]
    assert run("simulate", *chosen, "--orders", "many").exit_code == 2
    for wrong in ("0-9", "5-1", "1-900000000", "-3"):
        assert run("simulate", *chosen, "--orders", wrong).exit_code == 2


def test_names_outlast_training_where_they_still_fit(simulated: Path, tmp_path: Path) -> None:
    arguments = ("train", "--clouds", simulated, "--name", "m", "--store", tmp_path, "--workers", 1)
    assert run(*arguments).exit_code == 0
    store = ModelStore(tmp_path)
    concept = int(store.load("m", 1)[0].concepts().ids[0])
    store.concept_names("m", 1).change({concept: "mug"})
    result = run(*arguments)
    assert "1 names were carried over from m:1" in result.stdout
    assert store.concept_names("m", 2).read() == (1, {concept: "mug"}, {concept: "m:1"})
    assert store.aliases("m") == {"production": 2}


def test_training_publishes_versions_that_can_be_told_apart_only_by_number_and_time(
    simulated: Path, tmp_path: Path
) -> None:
    store = tmp_path / "store"
    manifests = []
    for workers in (1, 2):
        result = run("train", "--clouds", simulated, "--name", "m", "--store", store, "--workers", workers, "--json")
        assert result.exit_code == 0, result.output
        manifests.append(json.loads(result.stdout))
    models = ModelStore(str(store))
    assert models.versions("m") == [1, 2]
    assert models.resolve("m") == ("m", 2)
    files = [models.export("m", version, tmp_path / str(version)) for version in (1, 2)]
    tensors = [next(f for f in of_version if f.suffix == ".safetensors").read_bytes() for of_version in files]
    assert tensors[0] == tensors[1]
    for manifest in manifests:
        del manifest["version"], manifest["created"]
    assert manifests[0] == manifests[1]


def test_clouds_that_cannot_be_learnt_from_are_named(simulated: Path, tmp_path: Path) -> None:
    folder = tmp_path / "clouds"
    folder.mkdir()
    for file in sorted(simulated.glob("*.ply"))[:3]:
        (folder / file.name).write_bytes(file.read_bytes())
    (folder / "line.ply").write_bytes(write_ply(PointCloud(np.arange(600, dtype=np.float32).reshape(200, 3) * 1e-3)))
    (folder / "cut.ply").write_bytes(b"ply\n")
    result = run("train", "--clouds", folder, "--name", "m", "--store", tmp_path / "store", "--workers", 1, "--json")
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["counts"]["objects"] == 3
    assert sorted(json.loads(result.stdout)["left_out"]) == ["cut.ply", "line.ply"]
    assert "line" in result.stderr


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["--simulate", 5, "--clouds", "x", "--name", "m"], 2, "one of --clouds"),
        (["--name", "m"], 2, "one of --clouds"),
        (["--simulate", 1, "--name", "m"], 2, "--simulate"),
        (["--clouds", "/nowhere", "--name", "m"], 1, "no folder"),
        (["--simulate", 5, "--name", "Not A Name"], 1, "lower-case"),
        (["--simulate", 5, "--name", "m", "--config", "/nowhere.toml"], 1, "cannot be read"),
    ],
)
def test_what_cannot_be_trained_is_said_before_any_work(
    arguments: list[str], code: int, said: str, tmp_path: Path
) -> None:
    result = run("train", *arguments, "--store", tmp_path / "store")
    assert (result.exit_code, said in result.stderr) == (code, True), result.output
    assert not list((tmp_path / "store").rglob("*.json"))


def test_one_cloud_is_not_enough(simulated: Path, tmp_path: Path) -> None:
    (tmp_path / "one.ply").write_bytes(next(simulated.glob("*.ply")).read_bytes())
    result = run("train", "--clouds", tmp_path, "--name", "m", "--store", tmp_path / "store", "--workers", 1)
    assert result.exit_code == 1
    assert "at least 2 clouds" in result.stderr


@pytest.mark.parametrize("command", [[], ["simulate"], ["train"]])
def test_help_shows_examples_that_run(command: list[str]) -> None:
    result = run(*command, "--help")
    assert result.exit_code == 0
    assert "  shape-concepts-worker " in result.output
