"""What is left of a model when motif levels are taken away."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.sparse import csr_array

from service.engine.model import ShapeModel
from service.engine.perception import perceive
from service.engine.stimuli import Stimuli
from tests.learnt import learnt, named_clouds, perceived
from worker.evaluation.ablation import Arm, arms_of, even, respond_by, restrict, stimuli_of, tells_apart
from worker.learning.train import train


@cache
def evened() -> ShapeModel:
    return even(learnt())


@cache
def clouds() -> tuple[Stimuli, ...]:
    return tuple(stimuli_of(evened(), perceived()[:6]))


def test_a_rank_that_weighs_nothing_counts_as_one_and_the_others_stay_what_they_are() -> None:
    model, ranks = learnt(), learnt().ensemble.vertex_ranks
    assert model.params.stimuli.union_weight == 0
    before, after = model.stimuli.toarray(), evened().stimuli.toarray()
    assert not before[:, ranks == 1].any()
    assert after[:, ranks == 1].sum(axis=1) == pytest.approx(np.full(len(after), len(ranks)), rel=1e-5)
    assert np.array_equal(before[:, ranks != 1], after[:, ranks != 1])


def test_what_is_remembered_of_training_objects_gives_the_stimuli_that_they_had() -> None:
    for row, own in enumerate(stimuli_of(evened(), perceived())):
        start, stop = evened().stimuli.indptr[row : row + 2]
        assert np.array_equal(own.indices, evened().stimuli.indices[start:stop])
        assert np.array_equal(own.values, evened().stimuli.data[start:stop])


def test_a_model_whose_ranks_all_weigh_something_is_left_as_it_is() -> None:
    assert even(evened()) is evened()
    assert even(learnt("paper")) is learnt("paper")


def every_level(model: ShapeModel) -> tuple[int, ...]:
    return tuple(np.unique(model.ensemble.vertex_levels).tolist())


def test_with_every_level_left_the_model_is_what_it_was() -> None:
    model, arm = learnt("paper"), Arm("all", every_level(learnt("paper")))
    restricted = restrict(model, arm)
    assert restricted is not None
    assert np.array_equal(restricted.space.edges, model.space.edges)
    assert restricted.filtration.epsilon_max == model.filtration.epsilon_max
    own = np.stack([model.respond(named.cloud).responses for named in named_clouds()[:6]])
    seen = stimuli_of(model, [perceive(named.cloud, model.params) for named in named_clouds()[:6]])
    assert np.allclose(respond_by(restricted, arm, seen), own)


def test_without_what_weighs_nothing_the_model_answers_as_it_does() -> None:
    model, levels = learnt(), every_level(learnt())
    arm = Arm("all but unions", (levels[0], levels[-1]))
    restricted = restrict(evened(), arm)
    assert restricted is not None
    own = np.stack([model.respond(named.cloud).responses for named in named_clouds()[:6]])
    assert np.allclose(respond_by(restricted, arm, clouds()), own)


def test_evened_stimuli_are_those_of_a_model_that_is_trained_so() -> None:
    params = learnt().params.model_copy(
        update={"stimuli": learnt().params.stimuli.model_copy(update={"union_weight": 1.0})}
    )
    trained = train(named_clouds(), params).model
    assert (trained.stimuli != evened().stimuli).nnz == 0


def test_responses_that_are_the_same_for_all_clouds_tell_nothing() -> None:
    alike = np.ones((5, 3))
    assert not tells_apart(alike)
    one = alike * [1, 1, 0]
    one[2, 2] = 1
    assert not tells_apart(one)
    assert tells_apart(np.random.default_rng(0).random((5, 3)))


def test_where_wholes_stand_on_several_levels_none_is_called_so() -> None:
    names = {arm.name for arm in arms_of(learnt("paper").ensemble, whole_apart=False)}
    assert not any("whole" in name for name in names)
    assert "all but the highest motif level" in names


def test_what_is_taken_away_has_no_say() -> None:
    model = evened()
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
    assert restrict(learnt(), Arm("unions", tuple(range(2, 13)))) is None
    assert restrict(learnt(), Arm("segments", (1,))) is not None
