"""The steps of jobs: each may be done twice, and together those of training are what `train` does."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from service.clouds import write_ply
from service.datasets import Datasets
from service.engine.errors import CloudExists, DatasetNotFound, InvalidParameter, NotEnoughSamples
from service.engine.model import ShapeModel
from service.job_specs import EvaluateSpec, SimulateSpec, TrainSpec, read_spec
from service.labels import Label
from service.model_file import encode
from service.objects import Objects
from service.store import ModelStore
from worker.job_steps import (
    STAGES,
    Place,
    evaluate_model,
    gather,
    judge,
    learn,
    promote,
    publish,
    simulate_into,
    stages_of,
)
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


class Told:
    """What a step has told of itself."""

    def __init__(self) -> None:
        self.stages: list[str] = []
        self.lines: list[str] = []
        self.counted = 0

    def stage(self, name: str, total: int | None = None) -> None:
        self.stages.append(name)

    def count(self, items: Iterable[Any], total: int) -> Iterator[Any]:
        for item in items:
            self.counted += 1
            yield item

    def log(self, line: str) -> None:
        self.lines.append(line)


@pytest.fixture
def tell() -> Told:
    return Told()


@pytest.fixture
def store(tmp_path: Path) -> ModelStore:
    return ModelStore(tmp_path)


@pytest.fixture
def place(tmp_path: Path) -> Place:
    return Place(str(tmp_path), "one", 1)


def kept(spec: TrainSpec, place: Place, model: ShapeModel) -> None:
    """What the steps before publishing leave behind."""
    gather(Told(), spec, place)
    place.files.write_model(model)


def labelled(place: Place, name: str = "table") -> None:
    """A dataset of eight objects of two kinds, twice each, and one cloud without a label."""
    datasets = Datasets(place.store)
    datasets.create(name)
    for simulated in simulate(13, 4, renderer="raycast", orders=(1, 3)):
        label = Label(category=f"order {simulated.order}") if simulated.index < 12 else None
        datasets.put(name, f"{simulated.index}.ply", write_ply(simulated.cloud), label=label)


def test_a_job_learns_bit_for_bit_what_training_learns(
    spec: TrainSpec, tell: Told, place: Place, model: ShapeModel
) -> None:
    assert gather(tell, spec, place) == 6
    assert learn(tell, spec, place) == {"clouds": 6, "left_out": 1}
    assert "broken.ply" in tell.lines[0]
    assert encode(place.files.model(spec.params)) == encode(model)


def test_the_stages_told_are_those_announced_in_their_order(spec: TrainSpec, tell: Told, place: Place) -> None:
    labelled(place)
    asked = spec.model_copy(update={"labelled": "table"})
    gather(tell, asked, place)
    learn(tell, asked, place)
    published = publish(tell, asked, place, judge(tell, asked, place), "one-1")
    promote(tell, asked, place, published["version"], published["parent"])
    assert tell.stages == list(stages_of(asked))
    assert sum(stages_of(asked).values()) == pytest.approx(1)


def test_what_is_learnt_from_a_dataset_and_from_simulation_says_so(tell: Told, place: Place, store: ModelStore) -> None:
    labelled(place)
    spec = TrainSpec(name="both", datasets=("table",), simulate=3, simulation={"renderer": "raycast"})
    assert gather(tell, spec, place) == 16
    learn(tell, spec, place)
    publish(tell, spec, place, {"knn": 0.5}, "one-1")
    manifest = store.manifest("both", 1)
    dataset, simulated = manifest.source["parts"]
    assert dataset == {
        "kind": "dataset",
        "name": "table",
        "digest": Datasets(place.store).digest("table"),
        "clouds": 13,
    }
    assert (simulated["kind"], simulated["clouds"], manifest.source["clouds"]) == ("simulation", 3, 16)
    assert (manifest.metrics, manifest.job, manifest.parent) == ({"knn": 0.5}, "one", None)


def test_the_parent_is_the_version_that_was_meant_when_the_job_began(
    spec: TrainSpec, tell: Told, place: Place, store: ModelStore, model: ShapeModel
) -> None:
    store.publish(model, name="toys", seed=5, source={})
    child = spec.model_copy(update={"parent": "toys"})
    kept(child, place, model)
    store.publish(model, name="toys", seed=5, source={})
    publish(tell, child, place, None, "one-1")
    assert store.manifest("toys", 3).parent == "toys:1"


def test_gathering_again_gives_the_same_clouds(spec: TrainSpec, tell: Told, place: Place) -> None:
    gather(tell, spec, place)
    first = list(place.files.clouds())
    gather(tell, spec, place)
    again = list(place.files.clouds())
    assert [named.key for named in first] == [named.key for named in again]
    assert all(np.array_equal(a.cloud.points, b.cloud.points) for a, b in zip(first, again, strict=True))


def test_publishing_again_makes_no_second_version(
    spec: TrainSpec, tell: Told, place: Place, store: ModelStore, model: ShapeModel
) -> None:
    kept(spec, place, model)
    first = publish(tell, spec, place, None, "one-1")
    assert first == publish(tell, spec, place, None, "one-1") == {"version": 1, "parent": None}
    assert store.versions("toys") == [1]


def test_the_same_job_later_makes_a_version_of_its_own(
    spec: TrainSpec, tell: Told, place: Place, store: ModelStore, model: ShapeModel
) -> None:
    kept(spec, place, model)
    publish(tell, spec, place, None, "one-1")
    assert publish(tell, spec, place, None, "one-2")["version"] == 2
    assert store.manifest("toys", 2).job == "one"


def test_a_kill_between_version_and_alias_is_made_good(
    spec: TrainSpec, tell: Told, place: Place, store: ModelStore, model: ShapeModel
) -> None:
    kept(spec, place, model)
    assert publish(tell, spec, place, None, "one-1")["version"] == 1
    assert store.aliases("toys") == {}
    for _ in range(2):
        assert promote(tell, spec, place, 1, None)["promoted"]
    assert store.aliases("toys") == {"production": 1}
    assert len(store.alias_history("toys")) == 1


class TestPromotion:
    @pytest.fixture
    def twice(self, store: ModelStore, model: ShapeModel) -> ModelStore:
        """A store with the model as toys:1, which production means, and toys:2."""
        store.publish(model, name="toys", seed=5, source={})
        store.publish(model, name="toys", seed=5, source={}, alias=None)
        return store

    def test_never_leaves_the_alias_to_people_but_names_are_carried_over(
        self, spec: TrainSpec, tell: Told, place: Place, twice: ModelStore, model: ShapeModel
    ) -> None:
        concept = int(model.concepts().ids[0])
        twice.concept_names("toys", 1).change({concept: "block"})
        made = promote(tell, spec.model_copy(update={"promote": "never"}), place, 2, None)
        assert (made["promoted"], made["names_carried"]) == (False, 1)
        assert twice.aliases("toys") == {"production": 1}
        assert twice.concept_names("toys", 2).read() == (1, {concept: "block"}, {concept: "toys:1"})

    def test_not_worse_is_promoted_with_reasons_and_once(
        self, spec: TrainSpec, tell: Told, place: Place, twice: ModelStore
    ) -> None:
        labelled(place)
        rule = spec.model_copy(update={"promote": "not-worse", "labelled": "table", "tolerance": 0.0})
        made = promote(tell, rule, place, 2, "toys:1")
        assert made["promoted"]
        assert len(made["reasons"]) == 5
        assert "toys@production is version 2 now." in tell.lines
        assert twice.aliases("toys") == {"production": 2}
        assert promote(tell, rule, place, 2, "toys:1")["promoted"]
        assert len(twice.alias_history("toys")) == 2

    def test_worse_stays_back(
        self, spec: TrainSpec, tell: Told, place: Place, store: ModelStore, model: ShapeModel
    ) -> None:
        labelled(place)
        store.publish(model, name="toys", seed=5, source={})
        blind = replace(model.metric, components=np.zeros_like(model.metric.components))
        store.publish(replace(model, metric=blind), name="toys", seed=5, source={}, alias=None)
        rule = spec.model_copy(update={"promote": "not-worse", "labelled": "table"})
        made = promote(tell, rule, place, 2, None)
        assert not made["promoted"]
        assert any("more than the tolerated" in reason for reason in made["reasons"])
        assert store.aliases("toys") == {"production": 1}

    def test_an_alias_that_means_a_later_version_by_now_stays(
        self, spec: TrainSpec, tell: Told, place: Place, twice: ModelStore
    ) -> None:
        labelled(place)
        twice.promote("toys", 2)
        rule = spec.model_copy(update={"promote": "not-worse", "labelled": "table"})
        assert not promote(tell, rule, place, 1, None)["promoted"]
        assert not promote(tell, spec, place, 1, None)["promoted"]
        assert twice.aliases("toys") == {"production": 2}


def test_what_extends_a_model_learns_from_its_sources_first_and_names_it_as_parent(
    tell: Told, place: Place, store: ModelStore
) -> None:
    labelled(place)
    first = TrainSpec(name="toys", simulate=3, simulation={"renderer": "raycast"})
    gather(tell, first, place)
    learn(tell, first, place)
    publish(tell, first, place, None, "one-1")
    promote(tell, first, place, 1, None)
    more = TrainSpec(name="toys", extend="toys", datasets=("table",))
    assert gather(tell, more, place) == 16
    learn(tell, more, place)
    published = publish(tell, more, place, None, "two-1")
    assert published == {"version": 2, "parent": "toys:1"}
    simulated, dataset = store.manifest("toys", 2).source["parts"]
    assert simulated == store.manifest("toys", 1).source
    assert dataset["name"] == "table"
    promote(tell, more, place, 2, "toys:1")
    alone = TrainSpec(name="toys", extend="toys")  # the same again, as of the version that is meant by now
    assert gather(tell, alone, place) == 16
    assert [named.key for named in place.files.clouds()][:3] == [f"simulated/7/{number}" for number in range(3)]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"extend": "toys", "parent": "toys:1"}, "is the parent"),
        ({"simulate": 2, "promote": "not-worse"}, "labelled dataset"),
        ({"simulate": 2, "promote": "not-worse", "labelled": "table", "alias": None}, "alias to move"),
        ({"simulate": 2, "promote": "perhaps"}, "promote"),
        ({"extend": "Toys"}, "extend"),
        ({}, "extend"),
    ],
)
def test_what_contradicts_itself_is_no_job(given: dict[str, Any], said: str) -> None:
    with pytest.raises(InvalidParameter, match=said):
        read_spec({"name": "toys"} | given)


def test_an_evaluation_keeps_its_report(tell: Told, place: Place, store: ModelStore, model: ShapeModel) -> None:
    labelled(place)
    store.publish(model, name="toys", seed=5, source={})
    spec = EvaluateSpec(model="toys", dataset="table")
    result = evaluate_model(tell, spec, place, "toys:1")
    assert tell.stages == list(STAGES["evaluate"])
    assert (result["model"], result["version"], result["clouds"]) == ("toys", 1, 12)
    assert result["metrics"] == evaluate_model(tell, spec, place, "toys:1")["metrics"]
    report = Objects(place.store).get("reports/one/report.json").decode()
    assert "dataset table" in report
    assert "/tmp" not in report
    assert Objects(place.store).get("reports/one/report.html").startswith(b"<!")


def test_a_dataset_without_labels_judges_nothing(
    tell: Told, place: Place, store: ModelStore, model: ShapeModel
) -> None:
    store.publish(model, name="toys", seed=5, source={})
    simulate_into(tell, SimulateSpec(dataset="bare", count=2, simulation={"renderer": "raycast"}), place)
    with pytest.raises(InvalidParameter, match=r"labels.csv"):
        evaluate_model(tell, EvaluateSpec(model="toys", dataset="bare"), place, "toys:1")


def test_simulating_again_adds_nothing_and_otherwise_is_refused(tell: Told, place: Place) -> None:
    spec = SimulateSpec(dataset="toys", count=3, seed=2, simulation={"renderer": "raycast"})
    first = simulate_into(tell, spec, place)
    assert tell.counted == 3
    assert simulate_into(tell, spec, place) == first
    assert len(Datasets(place.store).entries("toys")) == 3
    with pytest.raises(CloudExists):
        simulate_into(tell, spec.model_copy(update={"simulation": {"renderer": "raycast", "noise": "none"}}), place)


def test_what_a_job_kept_can_be_removed(spec: TrainSpec, tell: Told, place: Place, tmp_path: Path) -> None:
    gather(tell, spec, place)
    assert Objects(tmp_path).keys("jobs")
    place.files.remove()
    place.files.remove()
    assert not Objects(tmp_path).keys("jobs")


def test_a_source_that_is_not_there_is_named(tell: Told, place: Place, tmp_path: Path) -> None:
    with pytest.raises(InvalidParameter, match="nowhere"):
        gather(tell, TrainSpec(name="toys", clouds=str(tmp_path / "nowhere")), place)
    with pytest.raises(DatasetNotFound, match="nowhere"):
        gather(tell, TrainSpec(name="toys", datasets=("nowhere",)), place)


def test_a_parameter_that_the_simulation_does_not_have_is_refused(tell: Told, place: Place) -> None:
    with pytest.raises(InvalidParameter, match="gravity"):
        gather(tell, TrainSpec(name="toys", simulate=2, simulation={"gravity": 9.81}), place)


def test_one_cloud_is_not_enough(tell: Told, place: Place, scans: Path, tmp_path: Path) -> None:
    (tmp_path / "one").mkdir()
    (tmp_path / "one" / "0.ply").write_bytes((scans / "0.ply").read_bytes())
    alone = TrainSpec(name="toys", clouds=str(tmp_path / "one"))
    gather(tell, alone, place)
    with pytest.raises(NotEnoughSamples):
        learn(tell, alone, place)


def test_a_judge_that_is_not_there_is_told_before_anything_is_simulated(
    spec: TrainSpec, tell: Told, place: Place
) -> None:
    with pytest.raises(DatasetNotFound, match="nope"):
        gather(tell, spec.model_copy(update={"labelled": "nope"}), place)


def test_labels_that_nothing_can_be_judged_by_are_told_before_anything_is_simulated(
    spec: TrainSpec, tell: Told, place: Place
) -> None:
    labelled(place)
    Datasets(place.store).label("table", {f"{number}.ply": Label(category="order 1") for number in range(12)})
    with pytest.raises(InvalidParameter, match=r"two categories of at least 6 .*order 1 12"):
        gather(tell, spec.model_copy(update={"labelled": "table"}), place)
    assert not list(Path(place.store).rglob("*.npy"))
