"""The steps of a training job: each may be done twice, and together they are what `train` does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from service.clouds import write_ply
from service.engine.errors import InvalidParameter, NotEnoughSamples
from service.engine.model import ShapeModel
from service.job_specs import TrainSpec
from service.model_file import encode
from service.objects import Objects
from service.store import ModelStore
from worker.job_steps import JobFiles, gather, learn, publish
from worker.learning.train import train
from worker.simulation import simulate
from worker.sources import Folder


@pytest.fixture(scope="module")
def scans(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of six clouds, and a file that is none."""
    folder = tmp_path_factory.mktemp("scans")
    for simulated in simulate(6, 3, renderer="raycast"):
        (folder / f"{simulated.index}.ply").write_bytes(write_ply(simulated.cloud))
    (folder / "broken.ply").write_bytes(b"ply\n")
    return folder


@pytest.fixture(scope="module")
def spec(scans: Path) -> TrainSpec:
    return TrainSpec(name="toys", clouds=str(scans), seed=5)


@pytest.fixture(scope="module")
def model(scans: Path, spec: TrainSpec) -> ShapeModel:
    """What `train` learns from the folder."""
    return train(Folder(scans), spec.params, spec.seed).model


@pytest.fixture
def store(tmp_path: Path) -> ModelStore:
    return ModelStore(tmp_path)


@pytest.fixture
def files(tmp_path: Path) -> JobFiles:
    return JobFiles(Objects(tmp_path), "one")


def test_a_job_learns_bit_for_bit_what_training_learns(spec: TrainSpec, files: JobFiles, model: ShapeModel) -> None:
    assert gather(spec, files, lambda: None) == 6
    assert set(learn(spec, files, lambda stage: None)) == {"broken.ply"}
    assert encode(files.model(spec)) == encode(model)


def test_gathering_again_gives_the_same_clouds(spec: TrainSpec, files: JobFiles) -> None:
    gather(spec, files, lambda: None)
    first = list(files.clouds())
    gather(spec, files, lambda: None)
    again = list(files.clouds())
    assert [named.key for named in first] == [named.key for named in again]
    assert all(np.array_equal(a.cloud.points, b.cloud.points) for a, b in zip(first, again, strict=True))


def gathered(spec: TrainSpec, files: JobFiles, model: ShapeModel) -> None:
    gather(spec, files, lambda: None)
    files.write_model(model)


def test_publishing_again_makes_no_second_version(
    spec: TrainSpec, files: JobFiles, store: ModelStore, model: ShapeModel
) -> None:
    gathered(spec, files, model)
    assert publish(spec, files, store, "one", "one-1") == publish(spec, files, store, "one", "one-1") == 1
    assert store.versions("toys") == [1]


def test_the_same_job_later_makes_a_version_of_its_own(
    spec: TrainSpec, files: JobFiles, store: ModelStore, model: ShapeModel
) -> None:
    gathered(spec, files, model)
    publish(spec, files, store, "one", "one-1")
    assert publish(spec, files, store, "one", "one-2") == 2
    assert store.manifest("toys", 2).job == "one"


def test_a_kill_between_version_and_alias_is_made_good(
    spec: TrainSpec, files: JobFiles, store: ModelStore, model: ShapeModel
) -> None:
    gathered(spec, files, model)
    without_alias = spec.model_copy(update={"alias": None})
    assert publish(without_alias, files, store, "one", "one-1") == 1
    assert store.aliases("toys") == {}
    assert publish(spec, files, store, "one", "one-1") == 1
    assert store.aliases("toys") == {"production": 1}


def test_what_a_job_kept_can_be_removed(spec: TrainSpec, files: JobFiles, store: ModelStore, tmp_path: Path) -> None:
    gather(spec, files, lambda: None)
    assert Objects(tmp_path).keys("jobs")
    files.remove()
    files.remove()
    assert not Objects(tmp_path).keys("jobs")


def test_a_folder_that_is_not_there_is_named(files: JobFiles, tmp_path: Path) -> None:
    with pytest.raises(InvalidParameter, match="nowhere"):
        gather(TrainSpec(name="toys", clouds=str(tmp_path / "nowhere")), files, lambda: None)


def test_a_parameter_that_the_simulation_does_not_have_is_refused(files: JobFiles) -> None:
    with pytest.raises(InvalidParameter, match="gravity"):
        gather(TrainSpec(name="toys", simulate=2, simulation={"gravity": 9.81}), files, lambda: None)


def test_one_cloud_is_not_enough(spec: TrainSpec, files: JobFiles, scans: Path, tmp_path: Path) -> None:
    (tmp_path / "one").mkdir()
    (tmp_path / "one" / "0.ply").write_bytes((scans / "0.ply").read_bytes())
    alone = TrainSpec(name="toys", clouds=str(tmp_path / "one"))
    gather(alone, files, lambda: None)
    with pytest.raises(NotEnoughSamples):
        learn(alone, files, lambda stage: None)
