"""What becomes of sets: constructed partitions whose fates are known, and laws that hold for all."""

from __future__ import annotations

from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.sparse import csr_array

from service.engine.fates import Change, changes, counterparts, share


def fates(old: list[int], new: list[int]) -> tuple[Change, ...]:
    """What becomes of the concepts of objects' old assignment when they get the new one."""
    return changes(share(sets(old), sets(new), np.ones(len(old))))


def sets(assignment: list[int]) -> csr_array:
    """Which objects belong to which concept (C, U)."""
    concepts = np.array(assignment)
    return csr_array((np.arange(concepts.max(initial=-1) + 1)[:, None] == concepts).astype(np.int64))


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
    assert told([0, 0, 2], [0, 0, 1]) == ["persists", "untold", "persists"]


def test_an_object_may_stand_for_several() -> None:
    halves = share(sets([0, 0, 0]), sets([0, 0, 1]), np.array([1.0, 1.0, 4.0]))
    assert changes(halves) == changes(share(sets([0] * 6), sets([0, 0, 1, 1, 1, 1]), np.ones(6)))


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
    found = counterparts(share(csr_array(nested), csr_array(other), np.ones(8)))
    assert {a: overlap.concept for a, overlap in found.items()} == {0: 0, 1: 1}  # 2 is like 1, but 1 is liker
