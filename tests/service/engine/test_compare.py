"""Two versions compared: models that were really learnt."""

from __future__ import annotations

import dataclasses

import pytest

from service.engine.compare import LEAST_ASKED, MOST_ASKED, affordable, common_objects, compare, find_counterparts
from service.engine.concepts import concepts_at
from service.engine.errors import InvalidParameter
from service.engine.params import DescriptorParams, ModelParams
from tests.learnt import learnt
from tests.service.versions import learnt_from


@pytest.mark.parametrize("preset", ["default", "paper"])
def test_every_concept_of_a_model_persists_against_itself(preset: str) -> None:
    model = learnt(preset)
    compared = compare(model, model)
    assert [change.fate for change in (*compared.old, *compared.new)] == ["persists"] * 2 * len(compared.old)
    assert all(change.overlaps[0].jaccard == 1 for change in compared.old)
    assert compared.common.shared == len(set(model.prototypes.cloud_hashes))
    assert compared.common.left_out == 0
    ids = model.spectrum().ids.tolist()
    assert [(found.old, found.new, found.jaccard) for found in compared.counterparts] == [(id, id, 1) for id in ids]


def test_a_concept_of_a_time_that_no_cloud_is_answered_at_has_its_counterpart_where_it_is_asked_for() -> None:
    model = learnt_from(0, 18)
    common, own = common_objects(model, model), set(model.spectrum().ids.tolist())
    rare = {int(node) for time in model.filtration.time for node in concepts_at(model.filtration, time).ids} - own
    node = min(rare)
    found = find_counterparts(model, model, common, besides=[node, 10**6])
    assert {each.old for each in found} <= own | {node}
    assert {(each.old, each.new) for each in found if each.old in own} == {(id, id) for id in own}


def test_the_same_clouds_in_another_order_and_with_another_seed_give_the_same_concepts() -> None:
    compared = compare(learnt_from(0, 18), learnt_from(0, 18, seed=3, step=-1))
    assert compared.common.shared == 18
    assert {change.fate for change in (*compared.old, *compared.new)} == {"persists"}


def test_with_clouds_added_every_object_is_told_of_by_both() -> None:
    old, new = learnt_from(0, 18), learnt_from(0, 24)
    compared = compare(old, new)
    assert (compared.common.shared, compared.common.left_out) == (18, 0)
    assert len(compared.common.old) == 24
    assert (compared.common.new >= 0).all()  # the new version learnt from all of them
    assert "persists" in [change.fate for change in compared.old]
    assert sum(change.objects for change in compared.new) == (new.concepts().assignment >= 0).sum()


def test_versions_without_a_cloud_in_common_are_asked_about_each_others() -> None:
    compared = compare(learnt_from(0, 12), learnt_from(12, 24))
    assert compared.common.shared == 0
    assert len(compared.common.old) == 24
    assert sum(change.objects for change in compared.old) > 0


def test_a_sample_of_what_must_be_asked_depends_on_the_clouds_alone_and_stands_for_all() -> None:
    old, new = learnt_from(0, 18), learnt_from(6, 24)
    some, exchanged = common_objects(old, new, most_asked=4), common_objects(new, old, most_asked=4)
    assert some.shared == 12
    assert some.weight.tolist() == exchanged.weight.tolist()
    assert sorted(some.weight.tolist()) == [1.0] * 12 + [1.5] * 8
    assert some.left_out == 0
    assert some.old.tolist() == exchanged.new.tolist()
    assert some.new.tolist() == exchanged.old.tolist()


def test_larger_models_are_asked_for_fewer_objects() -> None:
    small, large = learnt_from(0, 12), learnt_from(0, 24)
    pairs = len(large.ensemble.prototypes)
    assert affordable(small, large, 100 * pairs) == affordable(large, small, 100 * pairs) == 100
    assert affordable(small, large, pairs) == LEAST_ASKED
    assert affordable(small, large, 10**9) == MOST_ASKED


def test_models_that_describe_in_different_ways_are_compared_by_common_clouds_alone() -> None:
    model = learnt_from(0, 18)
    finer = dataclasses.replace(model, params=ModelParams(descriptor=DescriptorParams(shape_weight=0.5)))
    assert {change.fate for change in compare(model, finer).old} == {"persists"}
    assert compare(finer, learnt_from(0, 24)).common.left_out == 6
    with pytest.raises(InvalidParameter, match="no cloud in common"):
        compare(finer, learnt_from(18, 24))
