"""Two versions compared: constructed partitions with known fates, laws, and models that were really learnt."""

from __future__ import annotations

import dataclasses
from functools import cache
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.sparse import csr_array

from service.engine.compare import Change, changes, common_objects, compare, counterparts, members_of, share
from service.engine.errors import InvalidParameter
from service.engine.model import ShapeModel
from service.engine.params import DescriptorParams, ModelParams
from tests.learnt import learnt, objects
from worker.learning.train import NamedCloud, train

MIRRORED = {"persists": "persists", "merges": "splits", "splits": "merges", "disappears": "disappears"}


@cache
def version(first: int, end: int, seed: int = 0, step: int = 1) -> ShapeModel:
    """A model of some of 40 objects; with step -1 in reverse order."""
    clouds = [NamedCloud(f"{simulated.index}.ply", simulated.cloud) for simulated in objects(40)[first:end]]
    return train(clouds[::step], ModelParams(), seed).model


def fates(old: list[int], new: list[int]) -> tuple[Change, ...]:
    """What becomes of the concepts of objects' old assignment when they get the new one."""
    return changes(share(sets(old), sets(new)))


def sets(assignment: list[int]) -> csr_array:
    concepts = np.array(assignment)
    return members_of(concepts, concepts.max(initial=-1) + 1, np.arange(len(concepts)))


def told(old: list[int], new: list[int]) -> list[str]:
    return [change.fate for change in fates(old, new)]


def test_concepts_that_keep_most_of_their_objects_persist_whatever_their_numbers() -> None:
    assert told([0, 0, 0, 1, 1, 1, -1], [1, 1, 1, 0, 0, 0, -1]) == ["persists", "persists"]
    (change, _) = fates([0, 0, 0, 0, 1, 1], [1, 1, 1, -1, 0, 0])
    assert change.fate == "persists"
    assert change.objects == 4
    assert change.overlaps[0].concept == 1
    assert change.overlaps[0].objects == 3
    assert change.overlaps[0].jaccard == pytest.approx(3 / 4)


def test_two_equal_halves_merge_and_the_whole_is_no_longer_either() -> None:
    assert told([0, 0, 1, 1], [0, 0, 0, 0]) == ["merges", "merges"]
    assert told([0, 0, 0, 0], [0, 0, 1, 1]) == ["splits"]
    (split,) = fates([0, 0, 0, 0], [0, 0, 1, 1])
    assert [part.concept for part in split.overlaps] == [0, 1]


def test_a_large_concept_that_takes_in_a_small_one_persists_and_the_small_one_merges() -> None:
    assert told([0] * 8 + [1] * 2, [0] * 10) == ["persists", "merges"]
    (large,) = fates([0] * 10, [0] * 8 + [1] * 2)
    assert large.fate == "persists"
    assert [part.concept for part in large.overlaps] == [0, 1]  # what it lost is told too


def test_a_concept_whose_objects_are_scattered_disappears() -> None:
    assert told([0] * 4 + [-1] * 4, [-1] * 8) == ["disappears"]
    assert told([0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2], [0, 1, 2, 0, 0, 0, 0, 1, 1, 2, 2])[0] == "disappears"


def test_a_small_splinter_alone_makes_no_split() -> None:
    assert told([0] * 10, [0, 0] + [-1] * 8) == ["disappears"]
    assert told([0] * 10, [0] * 5 + [-1] * 5) == ["disappears"]  # half is not more than half
    assert told([0] * 10, [0] * 3 + [1] * 3 + [-1] * 4) == ["splits"]


def test_a_concept_without_a_common_object_is_untold() -> None:
    prototypes = np.array([0, 1, -1])  # of four prototypes, two stand for objects, and one object is novel
    old = members_of(np.array([0, 0, 1, 1]), 2, prototypes)
    assert [change.fate for change in changes(share(old, old))] == ["persists", "untold"]


assignments = st.integers(1, 40).flatmap(
    lambda size: st.tuples(*(arrays(np.int64, size, elements=st.integers(-1, 5)) for _ in range(2)))
)


@given(assignments)
def test_exchanged_versions_tell_the_same_pairs_the_other_way_round(pair: tuple[np.ndarray, np.ndarray]) -> None:
    old, new = (assignment.tolist() for assignment in pair)
    there, back = fates(old, new), fates(new, old)
    links = {(a, o.concept, o.objects, o.jaccard) for a, change in enumerate(there) for o in change.overlaps}
    assert links == {(o.concept, b, o.objects, o.jaccard) for b, change in enumerate(back) for o in change.overlaps}
    persisting = [
        {(a, o.concept) for a, change in enumerate(side) for o in change.overlaps if o.jaccard > 0.5}
        for side in (there, back)
    ]
    assert persisting[0] == {(a, b) for b, a in persisting[1]}
    assert len({b for _, b in persisting[0]}) == len(persisting[0])  # each has one partner at most


@given(assignments, st.randoms(use_true_random=False))
def test_neither_numbers_of_concepts_nor_the_order_of_objects_matter(
    pair: tuple[np.ndarray, np.ndarray], random: Random
) -> None:
    old, new = pair
    order = np.array(random.sample(range(len(old)), len(old)), np.int64)
    numbers = np.array([*random.sample(range(6), 6), -1], np.int64)  # -1 stays none
    plain, changed = fates(old.tolist(), new.tolist()), fates(old[order].tolist(), numbers[new[order]].tolist())
    assert [(c.fate, c.objects) for c in plain] == [(c.fate, c.objects) for c in changed]
    for one, other in zip(plain, changed, strict=True):
        assert {numbers[o.concept]: o.objects for o in one.overlaps} == {o.concept: o.objects for o in other.overlaps}


@given(assignments)
def test_a_partition_against_itself_only_persists(pair: tuple[np.ndarray, np.ndarray]) -> None:
    for change in fates(pair[0].tolist(), pair[0].tolist()):
        assert change.fate in ("persists", "untold")
        assert (change.fate == "untold") == (change.objects == 0)


def test_of_concepts_within_each_other_the_most_alike_are_counterparts_and_each_once() -> None:
    nested = np.array([[1, 1, 1, 1, 1, 1, 0, 0], [1, 1, 1, 0, 0, 0, 0, 0], [1, 1, 0, 0, 0, 0, 0, 0]])
    other = np.array([[1, 1, 1, 1, 1, 1, 1, 0], [1, 1, 1, 0, 0, 0, 0, 0]])
    found = counterparts(share(csr_array(nested), csr_array(other)))
    assert {a: overlap.concept for a, overlap in found.items()} == {0: 0, 1: 1}  # 2 is like 1, but 1 is liker


@pytest.mark.parametrize("preset", ["default", "paper"])
def test_every_concept_of_a_model_persists_against_itself(preset: str) -> None:
    model = learnt(preset)
    compared = compare(model, model)
    assert [change.fate for change in (*compared.old, *compared.new)] == ["persists"] * 2 * len(compared.old)
    assert all(change.overlaps[0].jaccard == 1 for change in compared.old)
    assert compared.common.shared == len(set(model.prototypes.cloud_hashes))
    assert compared.common.left_out == 0


def test_the_same_clouds_in_another_order_and_with_another_seed_give_the_same_concepts() -> None:
    compared = compare(version(0, 30), version(0, 30, seed=3, step=-1))
    assert compared.common.shared == 30
    assert {change.fate for change in (*compared.old, *compared.new)} == {"persists"}


def test_with_clouds_added_every_object_is_told_of_by_both() -> None:
    old, new = version(0, 30), version(0, 40)
    compared = compare(old, new)
    assert (compared.common.shared, compared.common.left_out) == (30, 0)
    assert len(compared.common.old) == 40
    assert (compared.common.new >= 0).all()  # the new version learnt from all of them
    assert "persists" in [change.fate for change in compared.old]
    assert sum(change.objects for change in compared.new) == (new.concepts().assignment >= 0).sum()


def test_versions_without_a_cloud_in_common_are_asked_about_each_others() -> None:
    compared = compare(version(0, 20), version(20, 40))
    assert compared.common.shared == 0
    assert len(compared.common.old) == 40
    assert sum(change.objects for change in compared.old) > 0


def test_a_sample_of_what_must_be_asked_depends_on_the_clouds_alone() -> None:
    old, new = version(0, 20), version(20, 40)
    some, exchanged = common_objects(old, new, most_asked=10), common_objects(new, old, most_asked=10)
    assert len(some.old) == 10
    assert some.left_out == 30
    assert some.old.tolist() == exchanged.new.tolist()
    assert some.new.tolist() == exchanged.old.tolist()


def test_models_that_describe_in_different_ways_are_compared_by_common_clouds_alone() -> None:
    model = version(0, 30)
    finer = dataclasses.replace(model, params=ModelParams(descriptor=DescriptorParams(shape_weight=0.5)))
    assert {change.fate for change in compare(model, finer).old} == {"persists"}
    assert compare(finer, version(0, 40)).common.left_out == 10
    with pytest.raises(InvalidParameter, match="no cloud in common"):
        compare(finer, version(30, 40))
