"""The command `promote`: a version that is not worse is promoted, and a worse one is not."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from service.clouds import write_ply
from service.engine.model import ShapeModel
from service.engine.params import ModelParams
from service.store import ModelStore
from worker.cli import main
from worker.learning.train import NamedCloud, train
from worker.simulation import simulate


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Labelled clouds of lone solids, and one that cannot be answered."""
    folder = tmp_path_factory.mktemp("solids")
    rows = ["file,category"]
    for o in simulate(24, 11, orders=(1,), noise="none", renderer="raycast"):
        (folder / f"{o.index}.ply").write_bytes(write_ply(o.cloud))
        rows.append(f"{o.index}.ply,{o.composition.prototypes[0].kind}")
    (folder / "empty.ply").write_bytes(b"")
    (folder / "labels.csv").write_text("\n".join([*rows, "empty.ply,box"]) + "\n")
    return folder


@pytest.fixture(scope="module")
def good() -> ShapeModel:
    clouds = simulate(16, 3, orders=(1, 2), renderer="raycast")
    return train([NamedCloud(str(o.index), o.cloud) for o in clouds], ModelParams()).model


@pytest.fixture(scope="module")
def poor(good: ShapeModel) -> ShapeModel:
    """A model whose metric sees nothing: every cloud is answered alike."""
    metric = dataclasses.replace(good.metric, components=np.zeros_like(good.metric.components))
    return dataclasses.replace(good, metric=metric)


def promote(store: ModelStore, folder: Path, model: str, *more: str) -> Result:
    arguments = ["promote", model, "--labels", str(folder / "labels.csv"), "--store", store.url, "--workers", "1"]
    return CliRunner().invoke(main, [*arguments, *more])


def test_a_worse_version_stays_back_and_every_figure_is_told(
    tmp_path: Path, folder: Path, good: ShapeModel, poor: ShapeModel
) -> None:
    store = ModelStore(tmp_path)
    store.publish(good, name="m", seed=1, source={})
    store.publish(poor, name="m", seed=1, source={}, alias="staging")
    refused = promote(store, folder, "m@staging", "--json")
    assert refused.exit_code == 1
    told = json.loads(refused.stdout)
    assert (told["promoted"], told["version"], told["before"]) == (False, 2, 1)
    assert set(told["figures"]) == {"knn", "svm", "within", "assigned", "answered"}
    assert told["figures"]["answered"] == told["figures_before"]["answered"] == 24 / 25
    assert len(told["reasons"]) == 5
    assert store.aliases("m")["production"] == 1
    better = promote(store, folder, "m:1", "--alias", "staging")
    assert better.exit_code == 0
    assert "m@staging is version 1 now" in better.stdout
    assert store.aliases("m") == {"production": 1, "staging": 1}


def test_the_same_model_again_is_not_worse_and_the_first_of_an_alias_needs_no_other(
    tmp_path: Path, folder: Path, good: ShapeModel
) -> None:
    store = ModelStore(tmp_path)
    store.publish(good, name="m", seed=1, source={}, alias=None)
    first = promote(store, folder, "m:1")
    assert "no version yet" in first.stdout
    assert store.aliases("m") == {"production": 1}
    store.publish(good, name="m", seed=1, source={}, alias=None)
    assert promote(store, folder, "m:2", "--tolerance", "0").exit_code == 0
    assert store.aliases("m") == {"production": 2}
    assert "already" in promote(store, folder, "m:2").stdout


def test_what_cannot_be_judged_moves_nothing(tmp_path: Path, folder: Path, good: ShapeModel) -> None:
    store = ModelStore(tmp_path / "store")
    store.publish(good, name="m", seed=1, source={}, alias=None)
    (tmp_path / "labels.csv").write_text("file,category\n")
    assert promote(store, tmp_path, "m:1").exit_code == 1
    assert promote(store, folder, "m:7").exit_code == 1
    assert promote(store, folder, "m").exit_code == 2
    assert store.aliases("m") == {}
