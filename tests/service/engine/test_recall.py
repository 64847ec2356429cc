"""What a model recalls of its training objects is all that is needed to be stimulated by them again."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from service.engine.params import CloudParams, ModelParams
from service.engine.recall import NOWHERE, place, recall, sees_as, stimulate_again
from tests.learnt import learnt, objects, perceived
from worker.learning.train import NamedCloud, train


def test_recalled_objects_stimulate_as_their_clouds_did_bit_for_bit() -> None:
    model = learnt()
    for number, each in enumerate(recall(model, range(len(model.prototypes.cloud_hashes)))):
        again = stimulate_again(model, each)
        row = model.stimuli[[number]]
        assert again.indices.tolist() == row.indices.tolist()
        assert again.values.tolist() == row.data.tolist()


def test_recalled_objects_are_described_as_they_were_seen() -> None:
    (each,) = recall(learnt(), [3])
    seen = perceived()[3]
    assert np.array_equal(each.descriptors, seen.descriptors)
    assert np.array_equal(each.constellations.coverage, seen.constellations.coverage)
    assert _rows(each.constellations.levels) == _rows(seen.constellations.levels)


def test_a_training_object_stands_where_it_is() -> None:
    model = learnt()
    numbers = range(len(model.prototypes.cloud_hashes))
    assert list(place(model, recall(model, numbers))) == list(numbers)


def test_another_model_places_a_foreign_object_by_what_is_recalled_as_it_would_by_its_cloud() -> None:
    clouds = [NamedCloud(f"{simulated.index}.ply", simulated.cloud) for simulated in objects()]
    some = train(clouds[:10], ModelParams()).model
    foreign = range(10, 14)
    for number, stands in zip(foreign, place(some, recall(learnt(), foreign)), strict=True):
        response = some.respond(clouds[number].cloud)
        assert (stands == NOWHERE) == (response.novelty >= 0.95)
        (each,) = recall(learnt(), [number])
        again = stimulate_again(some, each)
        assert again.indices.tolist() == response.stimuli.indices.tolist()
        assert again.values.tolist() == response.stimuli.values.tolist()


def test_models_see_alike_where_nothing_before_the_words_differs() -> None:
    model = learnt()
    assert sees_as(model, model)
    coarser = dataclasses.replace(model, params=ModelParams(cloud=CloudParams(voxel=1 / 24)))
    assert not sees_as(model, coarser)
    assert not sees_as(learnt("paper"), learnt("paper"))  # it fires by words, of segments that are not kept apart


def _rows(levels: NDArray[np.int64]) -> set[tuple[int, ...]]:
    return {tuple(row) for row in levels.tolist()}
