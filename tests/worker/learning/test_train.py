"""Learning as a whole: the same model for the same input, however the work is shared out."""

from __future__ import annotations

import hashlib

import joblib
import numpy as np
import pytest

from service.engine.cloud import PointCloud
from service.engine.errors import Cancelled, DegenerateCloud, NotEnoughSamples, TooFewPoints
from service.engine.model import ShapeModel
from service.engine.params import DictionaryParams, HierarchyParams, ModelParams
from tests.learnt import PRESETS, learnt, named_clouds, objects
from worker.learning.train import NamedCloud, Trained, train

presets = pytest.mark.parametrize("preset", PRESETS)
LINE = NamedCloud("line.ply", PointCloud(np.linspace(0, 1, 300, dtype=np.float32)[:, None] * np.float32([1, 1, 1])))
SCRAP = NamedCloud("scrap.ply", PointCloud(np.ones((5, 3), np.float32)))


def fingerprint(model: ShapeModel) -> dict[str, str]:
    """A digest of every tensor, so that a difference says where it is."""
    return {name: hashlib.sha256(array.tobytes()).hexdigest() for name, array in model.to_tensors().items()}


def learn(params: ModelParams | None = None, seed: int = 0, count: int = 9) -> Trained:
    return train(named_clouds(count), params or ModelParams(), seed)


def test_one_worker_and_two_learn_the_same_model_bit_for_bit():
    models = []
    for workers in (1, 2):
        with joblib.parallel_config(backend="loky", n_jobs=workers):
            models.append(fingerprint(train(named_clouds(), ModelParams()).model))
    assert models[0] == models[1]


@presets
def test_learning_twice_gives_the_same_bits(preset: str):
    again = train(named_clouds(), ModelParams.preset(preset)).model
    assert fingerprint(again) == fingerprint(learnt(preset))


def test_the_seed_draws_the_map_and_nothing_else():
    a, b = fingerprint(learn(seed=1).model), fingerprint(learn(seed=2).model)
    assert {name for name in a if a[name] != b[name]} <= {"prototypes.map"}


def test_a_generator_of_clouds_is_as_good_as_a_list():
    assert fingerprint(train(iter(named_clouds(9)), ModelParams()).model) == fingerprint(learn().model)


def test_the_order_of_a_clouds_points_changes_its_hash_alone():
    rng = np.random.default_rng(0)
    shuffled = [NamedCloud(key, PointCloud(rng.permutation(cloud.points))) for key, cloud in named_clouds(9)]
    a, b = fingerprint(train(shuffled, ModelParams()).model), fingerprint(learn().model)
    assert {name for name in a if a[name] != b[name]} == {"prototypes.cloud_hashes"}


@presets
def test_a_model_knows_its_clouds_by_name_and_content(preset: str):
    model, clouds = learnt(preset), named_clouds()
    assert model.prototypes.cloud_keys == tuple(named.key for named in clouds)
    assert model.prototypes.cloud_hashes == tuple(
        hashlib.sha256(named.cloud.points.tobytes()).hexdigest() for named in clouds
    )
    assert model.stimuli.shape == (len(clouds), model.ensemble.vertex_count)
    assert model.stimuli.dtype == np.float32


@presets
def test_presets_learn_what_they_say(preset: str):
    model, params = learnt(preset), ModelParams.preset(preset)
    assert model.params == params
    assert model.ensemble.prototypes.shape[1] == (33 if preset == "paper" else 153)
    assert len(model.dictionary.levels) == len(model.ensemble.hierarchies) == params.dictionary.levels
    assert len(model.concepts().sizes) >= 1


def test_parameters_reach_every_stage():
    params = ModelParams(
        dictionary=DictionaryParams(levels=2), hierarchy=HierarchyParams(max_constellations=1, max_levels=2)
    )
    model = learn(params).model
    assert [len(level) for level in model.dictionary.levels] == [2, 4]
    assert len(model.ensemble.prototypes) < len(learn().model.ensemble.prototypes)


def test_objects_beyond_those_memorised_are_prototypes_of_concepts_all_the_same():
    params = ModelParams(hierarchy=HierarchyParams(max_objects=4))
    model, whole = learn(params).model, learn().model
    assert model.stimuli.shape[0] == len(model.prototypes.cloud_keys) == len(model.novelty_scale.wholes) == 9
    assert np.diff(model.stimuli.indptr).min() > 0
    assert model.ensemble.vertex_count < whole.ensemble.vertex_count
    assert np.array_equal(model.novelty_scale.divergences, whole.novelty_scale.divergences)
    again = ShapeModel.from_tensors(model.to_tensors(), params)
    for named in named_clouds():
        a, b = (m.respond(named.cloud, explain=True) for m in (model, again))
        assert np.array_equal(a.responses, b.responses)
        assert np.isfinite(a.responses).all()
    assert fingerprint(learn(ModelParams(hierarchy=HierarchyParams(max_objects=9))).model) == fingerprint(whole)


def test_clouds_that_cannot_be_described_are_reported_and_left_out():
    clouds = [LINE, *named_clouds(4), SCRAP, *named_clouds(9)[4:]]
    trained = train(clouds, ModelParams())
    assert [key for key, _ in trained.refused] == ["line.ply", "scrap.ply"]
    assert isinstance(trained.refused[0][1], DegenerateCloud)
    assert isinstance(trained.refused[1][1], TooFewPoints)
    assert fingerprint(trained.model) == fingerprint(learn().model)


@pytest.mark.parametrize("clouds", [[], [LINE], named_clouds(1), [LINE, *named_clouds(1), SCRAP]])
def test_fewer_than_two_good_clouds_are_not_enough(clouds: list[NamedCloud]):
    with pytest.raises(NotEnoughSamples, match="at least 2") as refusal:
        train(clouds, ModelParams())
    if LINE in clouds:
        assert "line.ply" in str(refusal.value)


@presets
@pytest.mark.parametrize("picks", [[0, 1], [0, 0], [0, 0, 0, 0], [0, 0, 1], [0, 1, 2, 3]])
def test_a_handful_of_objects_even_if_all_alike_makes_a_model_that_answers(preset: str, picks: list[int]):
    clouds = named_clouds()
    model = train([NamedCloud(f"{i}", clouds[p].cloud) for i, p in enumerate(picks)], ModelParams.preset(preset)).model
    again = ShapeModel.from_tensors(model.to_tensors(), model.params)
    for named in clouds[:5]:
        response = again.respond(named.cloud)
        assert len(response.responses) >= 1
        assert np.isfinite(response.responses).all()
        assert np.isfinite(response.distances).all()
    assert np.isfinite(model.prototypes.map).all()


STAGES = [
    "segments and descriptors", "dictionary", "motif hierarchies", "stimuli", "topological space", "filtration",
    "concepts", "metric", "novelty", "map",
]  # fmt: skip


def test_stages_are_told_in_their_order_and_can_stop_the_work():
    told: list[str] = []
    train(named_clouds(3), ModelParams(), on_stage=told.append)
    assert told == STAGES

    def stop(stage: str) -> None:
        if stage == "filtration":
            raise Cancelled("enough")

    with pytest.raises(Cancelled):
        train(named_clouds(3), ModelParams(), on_stage=stop)


def test_the_clouds_are_left_as_they_were():
    clouds = named_clouds(3)
    before = [named.cloud.points.copy() for named in clouds]
    train(clouds, ModelParams())
    assert all(np.array_equal(named.cloud.points, points) for named, points in zip(clouds, before, strict=True))


@pytest.mark.slow
def test_many_objects_are_learnt_the_same_by_one_worker_and_by_two():
    clouds = [NamedCloud(f"{o.index}.ply", o.cloud) for o in objects(120, 3)]
    models = []
    for workers in (1, 2):
        with joblib.parallel_config(backend="loky", n_jobs=workers):
            models.append(fingerprint(train(clouds, ModelParams()).model))
    assert models[0] == models[1]
