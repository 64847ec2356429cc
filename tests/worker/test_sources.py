from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from joblib import parallel_config

from service.clouds import Viewpoint, read, write_ply
from service.datasets import Datasets
from service.engine.cloud import PointCloud
from service.engine.errors import DatasetNotFound, InvalidParameter
from service.engine.params import ModelParams
from service.model_file import encode
from tests.learnt import SIMULATION
from worker.learning.train import train
from worker.simulation import SimulationParams, simulate
from worker.sources import Dataset, Folder, Joined, Simulation


def ply(seed: int) -> bytes:
    points = np.random.default_rng(seed).normal(size=(120, 3)).astype(np.float32)
    return write_ply(PointCloud(points))


def test_a_folder_gives_its_clouds_in_the_order_of_their_paths(tmp_path: Path) -> None:
    (tmp_path / "below").mkdir()
    for name in ("b.ply", "a.PLY", "below/0.ply"):
        (tmp_path / name).write_bytes(ply(len(name)))
    (tmp_path / "labels.csv").write_text("file,category\na.PLY,box\n")
    (tmp_path / "notes.md").write_text("1 2 3")
    (tmp_path / "manifest.json").write_text("[[1, 2, 3]]")
    (tmp_path / "sheet.png").write_bytes(b"\x89PNG")
    source = Folder(tmp_path)
    assert [key for key, _ in source] == ["a.PLY", "b.ply", "below/0.ply"]
    assert source.count == 3
    assert source.refused == []


def test_what_cannot_be_read_is_refused_and_the_rest_goes_on(tmp_path: Path) -> None:
    (tmp_path / "good.ply").write_bytes(ply(1))
    (tmp_path / "broken.ply").write_bytes(ply(1)[:200])
    (tmp_path / "empty.pcd").write_bytes(b"")
    source = Folder(tmp_path)
    for _ in range(2):  # a second reading starts anew
        assert [key for key, _ in source] == ["good.ply"]
        assert sorted(key for key, _ in source.refused) == ["broken.ply", "empty.pcd"]


def test_where_the_folder_lies_is_not_part_of_the_input(tmp_path: Path) -> None:
    described = []
    for name in ("here", "there"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "a.ply").write_bytes(ply(1))
        described.append(Folder(tmp_path / name).describe())
    assert described[0] == described[1]


def test_no_folder_and_no_clouds_are_said(tmp_path: Path) -> None:
    with pytest.raises(InvalidParameter, match="no folder"):
        Folder(tmp_path / "none")
    with pytest.raises(InvalidParameter, match="no cloud"):
        Folder(tmp_path)


def test_a_simulation_gives_the_objects_of_its_seed() -> None:
    params = SimulationParams(renderer="raycast")
    source = Simulation(3, 5, params)
    expected = list(simulate(3, 5, params=params))
    given = list(source)
    assert [key for key, _ in given] == ["simulated/5/0", "simulated/5/1", "simulated/5/2"]
    for (_, cloud), simulated in zip(given, expected, strict=True):
        assert np.array_equal(cloud.points, simulated.cloud.points)
    assert source.describe()["parameters"] == params.model_dump(mode="json")


@pytest.fixture
def datasets(tmp_path: Path) -> Datasets:
    """A store with two datasets of two clouds each."""
    datasets = Datasets(tmp_path / "store")
    for name, seeds in (("first", (1, 2)), ("second", (3, 4))):
        datasets.create(name)
        for seed in seeds:
            assert datasets.add(name, f"{9 - seed}.ply", box(seed)).outcome == "accepted"
    return datasets


def box(seed: int) -> bytes:
    points = np.random.default_rng(seed).uniform((-0.05, -0.05, 0.45), (0.05, 0.05, 0.55), (150, 3))
    return write_ply(PointCloud(points.astype(np.float32)))


def test_a_dataset_gives_the_clouds_that_it_had_in_the_order_of_their_keys(datasets: Datasets) -> None:
    source = Dataset(datasets, "first")
    datasets.add("first", "later.ply", box(7))
    for _ in range(2):
        given = list(source)
        assert [key for key, _ in given] == ["first/7.ply", "first/8.ply"]
        for seed, (_, cloud) in zip((2, 1), given, strict=True):
            assert np.array_equal(cloud.points, read(box(seed)).points)
    assert (source.count, source.refused) == (2, [])
    described = source.describe()
    assert described == {"kind": "dataset", "name": "first", "digest": described["digest"], "clouds": 2}
    assert described["digest"] != datasets.digest("first")
    assert Dataset(datasets, "first").describe()["digest"] == datasets.digest("first")


def test_a_cloud_of_a_dataset_is_read_as_it_was_added(datasets: Datasets) -> None:
    pose = Viewpoint((0.0, 0.0, -100.0))
    millimetres = write_ply(PointCloud((read(box(1)).points * 1000).astype(np.float32)))
    datasets.create("posed")
    datasets.add("posed", "a.ply", millimetres, unit="mm", viewpoint=pose)
    ((_, cloud),) = list(Dataset(datasets, "posed"))
    assert np.array_equal(cloud.points, read(millimetres, unit="mm", viewpoint=pose).points)


def test_a_dataset_without_clouds_is_no_source(datasets: Datasets) -> None:
    datasets.create("empty")
    with pytest.raises(InvalidParameter, match="empty"):
        Dataset(datasets, "empty")
    with pytest.raises(DatasetNotFound):
        Dataset(datasets, "nobody")


def test_joined_sources_follow_one_another(datasets: Datasets, tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "broken.ply").write_bytes(b"ply\n")
    (tmp_path / "folder" / "good.ply").write_bytes(ply(1))
    parts = [Dataset(datasets, "second"), Folder(tmp_path / "folder"), Dataset(datasets, "first")]
    joined = Joined(parts)
    for _ in range(2):
        assert [key for key, _ in joined] == ["second/5.ply", "second/6.ply", "good.ply", "first/7.ply", "first/8.ply"]
        assert [key for key, _ in joined.refused] == ["broken.ply"]
    assert joined.count == 6
    assert joined.describe() == {"kind": "joined", "clouds": 6, "parts": [part.describe() for part in parts]}


def test_clouds_that_are_yet_to_be_simulated_are_those_that_are_simulated() -> None:
    source = Simulation(5, 3, SIMULATION)
    made, unmade = list(source), list(source.unmade())
    assert [each.key for each in unmade] == [each.key for each in made]
    for one, other in zip(unmade, made, strict=True):
        assert len(pickle.dumps(one)) < 5000 < len(pickle.dumps(other))
        assert np.array_equal(pickle.loads(pickle.dumps(one)).cloud.points, other.cloud.points)


def test_clouds_are_made_where_they_are_described_to_the_same_model_on_any_number_of_workers() -> None:
    source = Simulation(12, 3, SIMULATION)
    with parallel_config(backend="loky", n_jobs=1):
        models = [train(source, ModelParams()).model, train(source.unmade(), ModelParams()).model]
    with parallel_config(backend="loky", n_jobs=2):
        models.append(train(source.unmade(), ModelParams()).model)
    assert len({encode(model) for model in models}) == 1
