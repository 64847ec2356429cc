"""What novelty is measured by, against a plain version."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.distance import jensenshannon

from service.engine.params import ModelParams
from tests.learnt import PRESETS, learnt, named_clouds, perceived
from worker.learning import novelty
from worker.learning.train import train

presets = pytest.mark.parametrize("preset", PRESETS)


@presets
def test_each_training_object_is_left_out_in_turn(preset: str):
    seen = perceived(preset)
    wholes = [s.descriptors[s.constellations.members.all(axis=1)][0].astype(float) for s in seen]
    nearest = [min(jensenshannon(a, b) ** 2 for b in wholes if b is not a) for a in wholes]
    assert np.allclose(learnt(preset).novelty_scale.divergences, np.sort(nearest), atol=3e-6)


@presets
def test_every_whole_is_a_motif_prototype_of_its_object(preset: str):
    model = learnt(preset)
    assert np.array_equal(model.ensemble.objects[model.novelty_scale.wholes], np.arange(len(named_clouds())))


def test_how_many_objects_are_compared_at_a_time_does_not_matter(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(novelty, "ROWS", 3)
    again = train(named_clouds(), ModelParams()).model.novelty_scale
    assert np.array_equal(again.divergences, learnt().novelty_scale.divergences)
    assert np.array_equal(again.wholes, learnt().novelty_scale.wholes)
