"""What a model learnt from, again: every kind of source, and what to do where one is gone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from service.clouds import write_ply
from service.datasets import Datasets
from service.engine.errors import InvalidParameter
from service.model_file import Manifest
from service.store import ModelStore
from tests.learnt import learnt, objects
from worker.earlier import earlier_sources, join
from worker.simulation import SimulationParams
from worker.sources import Dataset, Folder, Joined, Simulation, Source

SIMULATED = SimulationParams(renderer="raycast", noise="none")


@pytest.fixture
def datasets(tmp_path: Path) -> Datasets:
    """Datasets "a" and "b" of two clouds each."""
    datasets = Datasets(tmp_path)
    for name, some in (("a", objects()[:2]), ("b", objects()[2:4])):
        datasets.create(name)
        for simulated in some:
            datasets.put(name, f"{simulated.index}.ply", write_ply(simulated.cloud))
    return datasets


def published(datasets: Datasets, source: Source | dict[str, object]) -> Manifest:
    told = source if isinstance(source, dict) else source.describe()
    return ModelStore(datasets.url).publish(learnt(), name="m", seed=1, source=told)


def test_the_sources_give_the_very_same_clouds_in_the_same_order(datasets: Datasets) -> None:
    learnt_from = Joined([Dataset(datasets, "b"), Simulation(2, 3, SIMULATED), Dataset(datasets, "a")])
    notes: list[str] = []
    again = Joined(earlier_sources(published(datasets, learnt_from), datasets, notes.append))
    assert again.describe() == learnt_from.describe()
    assert notes == []
    for one, other in zip(learnt_from, again, strict=True):
        assert one.key == other.key
        assert np.array_equal(one.cloud.points, other.cloud.points)


def test_what_was_joined_of_joined_ones_comes_apart(datasets: Datasets) -> None:
    nested = Joined([Joined([Dataset(datasets, "a")]), Dataset(datasets, "b")])
    sources = earlier_sources(published(datasets, nested), datasets, lambda note: None)
    assert [source.describe()["name"] for source in sources] == ["a", "b"]


def test_a_dataset_that_grew_is_learnt_from_as_it_is_and_that_is_told(datasets: Datasets) -> None:
    manifest = published(datasets, Dataset(datasets, "a"))
    datasets.put("a", "more.ply", write_ply(objects()[5].cloud))
    notes: list[str] = []
    (source,) = earlier_sources(manifest, datasets, notes.append)
    assert source.count == 3
    assert "'a' has changed since m:1" in notes[0]


def test_new_sources_come_after_and_none_is_learnt_from_twice(datasets: Datasets) -> None:
    earlier: list[Source] = [Dataset(datasets, "a"), Simulation(2, 3, SIMULATED)]
    joined = join(earlier, [Dataset(datasets, "a"), Dataset(datasets, "b"), Simulation(2, 4, SIMULATED)], "m:1")
    assert [source.describe().get("name", "simulated") for source in joined] == ["a", "simulated", "b", "simulated"]
    with pytest.raises(InvalidParameter, match=r"seed 3 already: for others, give another seed, as 4"):
        join(earlier, [Simulation(50, 3, SIMULATED)], "m:1")


@pytest.mark.parametrize(
    ("source", "advice"),
    [
        ({"kind": "dataset", "name": "gone", "digest": "", "clouds": 2}, "upload it again under that name"),
        ({"kind": "folder", "clouds": 2}, "upload them as a dataset"),
        ({"kind": "simulation", "clouds": 2, "seed": 1, "parameters": {"gravity": 1}}, "simulate in the place of"),
        ({"kind": "simulation", "clouds": 2}, "simulate in the place of"),
        ({"simulated": 8}, "datasets or simulation in the place of extend"),
        ({"kind": "joined", "parts": [{"kind": "folder"}]}, "upload them as a dataset"),
    ],
)
def test_a_source_that_is_gone_is_named_with_what_to_do(
    datasets: Datasets, source: dict[str, object], advice: str
) -> None:
    with pytest.raises(InvalidParameter, match=advice):
        earlier_sources(published(datasets, source), datasets, lambda note: None)


def test_a_folder_says_itself_that_it_cannot_be_learnt_from_again(datasets: Datasets, tmp_path: Path) -> None:
    (tmp_path / "scans").mkdir()
    (tmp_path / "scans" / "0.ply").write_bytes(write_ply(objects()[0].cloud))
    with pytest.raises(InvalidParameter, match="m:1 learnt from 1 clouds of a folder"):
        earlier_sources(published(datasets, Folder(tmp_path / "scans")), datasets, lambda note: None)
