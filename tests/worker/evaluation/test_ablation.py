"""What is left of a model when motif levels are taken away."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from scipy.sparse import csr_array

from service.engine.model import ShapeModel
from service.engine.params import ModelParams, StimuliParams
from service.engine.stimuli import Stimuli
from tests.learnt import learnt, named_clouds
from worker.evaluation.ablation import Arm, arms_of, respond_by, restrict


@cache
def clouds() -> tuple[Stimuli, ...]:
    return tuple(learnt().respond(named.cloud).stimuli for named in named_clouds()[:6])


def every_level(model: ShapeModel) -> tuple[int, ...]:
    return tuple(np.unique(model.ensemble.vertex_levels).tolist())


def test_with_every_level_left_the_model_is_what_it_was() -> None:
    model, arm = learnt(), Arm("all", every_level(learnt()))
    restricted = restrict(model, arm)
    assert restricted is not None
    assert np.array_equal(restricted.space.edges, model.space.edges)
    assert restricted.filtration.epsilon_max == model.filtration.epsilon_max
    own = np.stack([model.respond(named.cloud).responses for named in named_clouds()[:6]])
    assert np.allclose(respond_by(restricted, arm, clouds()), own)


def test_what_is_taken_away_has_no_say() -> None:
    model = learnt()
    for arm in arms_of(model.ensemble):
        kept = np.isin(model.ensemble.vertex_levels, arm.levels)
        loud = model.stimuli.multiply(np.where(kept, 1.0, 7.0)[None, :]).astype(np.float32)
        louder = replace(model, stimuli=csr_array(loud))
        first, second = restrict(model, arm), restrict(louder, arm)
        assert first is not None
        assert second is not None
        assert np.array_equal(first.stimuli.toarray(), second.stimuli.toarray())
        assert first.stimuli.toarray()[:, ~kept].sum() == 0
        shouted = [Stimuli(s.indices, np.where(kept[s.indices], s.values, s.values * 7)) for s in clouds()]
        assert np.array_equal(respond_by(first, arm, clouds()), respond_by(second, arm, shouted))


def test_arms_are_each_level_alone_the_levels_up_to_each_and_each_rank_left_out() -> None:
    ensemble = learnt().ensemble
    levels = every_level(learnt())
    arms = {arm.name: arm.levels for arm in arms_of(ensemble)}
    assert len(set(arms.values())) == len(arms)
    assert {of for of in arms.values() if len(of) == 1} == {(level,) for level in levels}
    assert arms["all but unions"] == (levels[0], levels[-1])
    assert arms["all but the whole object"] == levels[:-1]
    assert arms["all but single segments"] == levels[1:]
    for level in levels[1:-2]:
        assert arms[f"levels 1 to {level}"] == tuple(each for each in levels if each <= level)


def test_a_level_without_stimuli_is_no_arm_to_judge() -> None:
    silent = StimuliParams(union_weight=0)
    model = replace(learnt(), params=ModelParams(stimuli=silent))
    kept = learnt().ensemble.vertex_ranks != 1
    model = replace(model, stimuli=csr_array(model.stimuli.multiply(kept[None, :]).astype(np.float32)))
    assert restrict(model, Arm("unions", tuple(range(2, 13)))) is None
    assert restrict(model, Arm("segments", (1,))) is not None
