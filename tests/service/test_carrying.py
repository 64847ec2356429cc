"""Names carry over to the concepts that still are the same, and to no others."""

from __future__ import annotations

from pathlib import Path

import pytest

from service.carrying import carry_from_earlier, carry_names, names_to_carry
from service.engine.compare import common_objects, find_counterparts
from service.engine.model import ShapeModel
from service.store import ModelStore
from tests.learnt import learnt
from tests.service.versions import grown, learnt_from, small


@pytest.fixture
def store(tmp_path: Path) -> ModelStore:
    """A store that holds the earlier version as tiny:1 and the later one as tiny:2."""
    store = ModelStore(tmp_path)
    for model in (small(), grown()):
        store.publish(model, name="tiny", seed=7, source={})
    return store


def same(old: ShapeModel, new: ShapeModel) -> dict[int, int]:
    return {found.old: found.new for found in find_counterparts(old, new, common_objects(old, new))}


def test_a_name_follows_its_concept_and_says_where_it_comes_from(store: ModelStore) -> None:
    kept = same(small(), grown())
    ids = small().spectrum().ids.tolist()
    lost = [id for id in ids if id not in kept]
    store.concept_names("tiny", 1).change({id: f"thing {id}" for id in ids})
    carried = carry_names(store, ("tiny", 1), ("tiny", 2))
    names = store.concept_names("tiny", 2).read()
    assert names.of == {new: f"thing {old}" for old, new in kept.items()}
    assert set(names.carried.values()) == {"tiny:1"}
    assert {each.before for each in carried} == set(kept)
    assert all(each.jaccard > 0.5 for each in carried)
    assert kept
    assert lost  # some concepts of small models do not last: their names are not carried


def test_what_a_person_said_of_the_later_version_holds(store: ModelStore) -> None:
    (first, second, *_), kept = same(small(), grown()), same(small(), grown())
    store.concept_names("tiny", 1).change({first: "mug", second: "bowl"})
    log = store.concept_names("tiny", 2)
    log.change({kept[first]: "teacup", kept[second]: "dish"})
    log.change({kept[second]: None})
    assert carry_names(store, ("tiny", 1), ("tiny", 2)) == []
    assert log.read().of == {kept[first]: "teacup"}


def test_carried_twice_is_carried_once_and_told_again(store: ModelStore) -> None:
    (first, *_) = same(small(), grown())
    store.concept_names("tiny", 1).change({first: "mug"})
    assert carry_names(store, ("tiny", 1), ("tiny", 2)) == carry_names(store, ("tiny", 1), ("tiny", 2))
    assert store.concept_names("tiny", 2).read().changes == 1


def test_all_names_stay_with_the_same_clouds_in_another_order() -> None:
    again = learnt_from(0, 18, seed=3, step=-1)
    names = {id: f"thing {id}" for id in small().spectrum().ids.tolist()}
    assert {each.name for each in names_to_carry(small(), names, again)} == set(names.values())


def test_a_version_without_an_earlier_one_that_compares_gets_no_names(store: ModelStore) -> None:
    store.publish(learnt("paper"), name="other", seed=7, source={})
    (first, *_) = same(small(), grown())
    store.concept_names("tiny", 1).change({first: "mug"})
    store.concept_names("other", 1).change({int(learnt("paper").spectrum().ids[0]): "pot"})
    assert carry_from_earlier(store, None, ("tiny", 2)) == []
    assert carry_from_earlier(store, "tiny:2", ("tiny", 2)) == []
    assert carry_from_earlier(store, "tiny:9", ("tiny", 2)) == []
    assert [each.name for each in carry_from_earlier(store, "tiny:1", ("tiny", 2))] == ["mug"]
