"""Two versions, compared as the service tells it."""

from __future__ import annotations

from service.comparing import Version, VersionComparison, compare_versions
from service.transports.rest.model_examples import CARRIED, COMPARISON
from service.transports.rest.names import CarriedNames
from tests.service.versions import grown, small


def test_every_old_and_new_concept_is_told_once_with_its_names() -> None:
    old_ids, new_ids = (version.concepts().ids.tolist() for version in (small(), grown()))
    told = compare_versions(
        Version("tiny", 1, small(), {old_ids[0]: "mug"}), Version("tiny", 2, grown(), {new_ids[0]: "bowl"})
    )
    assert [concept.id for concept in told.old_concepts] == old_ids
    assert [concept.id for concept in told.new_concepts] == new_ids
    assert sum(told.fates.values()) == len(old_ids)
    assert sum(told.origins.values()) == len(new_ids)
    assert told.old_concepts[0].name == "mug"
    assert told.new_concepts[0].name == "bowl"
    assert (told.shared, told.asked, told.left_out) == (18, 6, 0)
    assert {related.id for concept in told.old_concepts for related in concept.concepts} <= set(new_ids)


def test_what_persists_persists_on_both_sides() -> None:
    told = compare_versions(Version("tiny", 1, small(), {}), Version("tiny", 2, grown(), {}))
    there = [c.concepts[0].id for c in told.old_concepts if c.fate == "persists"]
    assert set(there) == {c.id for c in told.new_concepts if c.origin == "persists"}
    assert told.fates.get("persists", 0) == told.origins.get("persists", 0) > 0


def test_a_version_against_itself_is_the_same_in_all() -> None:
    told = compare_versions(Version("tiny", 1, small(), {}), Version("tiny", 1, small(), {}))
    assert set(told.fates) == set(told.origins) == {"persists"}
    assert {(same.old, same.new) for same in told.same_concepts} == {(id, id) for id in small().spectrum().ids.tolist()}


def test_the_documented_examples_are_such_answers() -> None:
    assert VersionComparison.model_validate(COMPARISON).model_dump(mode="json") == COMPARISON
    assert CarriedNames.model_validate(CARRIED).model_dump(mode="json") == CARRIED
