"""Names of concepts: a log beside the model, of which every reader sees the last entry."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from service.engine.errors import InvalidParameter, ModelDamaged
from service.names import LONGEST, NO_NAMES, NameLog, Names, check_concept_name
from service.objects import Objects


@pytest.fixture
def log(tmp_path: Path) -> NameLog:
    return NameLog(Objects(tmp_path), "models/tiny/names/00000001")


def test_what_was_named_is_read_by_everybody(log: NameLog, tmp_path: Path) -> None:
    assert log.read() == NO_NAMES
    assert log.change({20: "mug"}) == Names(1, {20: "mug"})
    assert log.change({21: "Schüssel", 22: "碗"}).of == {20: "mug", 21: "Schüssel", 22: "碗"}
    other = NameLog(Objects(tmp_path), "models/tiny/names/00000001")
    assert other.read() == log.read(Names(1, {20: "mug"})) == Names(2, {20: "mug", 21: "Schüssel", 22: "碗"})
    assert NameLog(Objects(tmp_path), "models/tiny/names/00000002").read() == NO_NAMES


def test_naming_again_adds_nothing_and_the_history_keeps_what_was(log: NameLog) -> None:
    for _ in range(2):
        log.change({20: "mug"})
    log.change({21: "bowl"})
    log.change({20: "cup"})
    log.change({20: None})
    assert log.change({20: None}) == Names(4, {21: "bowl"})
    assert [entry.name for entry in log.history(20)] == ["mug", "cup", None]
    assert [entry.name for entry in log.history(21)] == ["bowl"]
    assert log.history(22) == []
    assert all(entry.at.endswith("+00:00") for entry in log.history(20))


def test_of_many_who_name_at_once_none_is_lost(log: NameLog) -> None:
    with ThreadPoolExecutor(8) as threads:
        list(threads.map(lambda concept: log.change({concept: f"thing {concept}"}), range(24)))
    assert log.read() == Names(24, {concept: f"thing {concept}" for concept in range(24)})


def test_names_are_carried_over_only_to_concepts_that_were_never_touched(log: NameLog, tmp_path: Path) -> None:
    log.change({20: "cup", 21: "bowl"})
    log.change({21: None})
    carried = log.carry({20: "mug", 21: "bowl", 22: "can"}, "tiny:1")
    assert carried == Names(3, {20: "cup", 22: "can"}, {22: "tiny:1"})
    assert log.carry({22: "can", 20: "mug"}, "tiny:1") == carried  # again, it is done once
    assert NameLog(Objects(tmp_path), "models/tiny/names/00000001").read() == carried
    assert [(entry.name, entry.carried_from) for entry in log.history(22)] == [("can", "tiny:1")]
    assert [entry.carried_from for entry in log.history(20)] == [None]


def test_what_was_carried_over_is_a_persons_once_it_is_given_again(log: NameLog) -> None:
    log.carry({20: "mug", 21: "bowl", 22: "can"}, "tiny:1")
    assert log.change({20: "mug"}) == Names(2, {20: "mug", 21: "bowl", 22: "can"}, {21: "tiny:1", 22: "tiny:1"})
    assert log.change({21: "dish"}).carried == {22: "tiny:1"}
    assert log.change({22: None}) == Names(4, {20: "mug", 21: "dish"})
    assert log.carry({20: "pot", 21: "pot", 22: "pot"}, "tiny:2") == Names(4, {20: "mug", 21: "dish"})


def test_of_a_person_and_a_carrier_at_once_the_persons_name_holds(log: NameLog) -> None:
    with ThreadPoolExecutor(8) as threads:
        for concept in range(12):
            threads.submit(log.carry, {concept: "carried"}, "tiny:1")
            threads.submit(log.change, {concept: "given"})
    assert log.read().of == dict.fromkeys(range(12), "given")
    assert log.read().carried == {}


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b'{"names": {"x": "y"}, "changed": {}, "at": ""}'])
def test_an_altered_entry_is_refused(log: NameLog, tmp_path: Path, content: bytes) -> None:
    log.change({20: "mug"})
    (entry,) = tmp_path.rglob("00000001.json")
    entry.write_bytes(content)
    with pytest.raises(ModelDamaged, match="Entry 1"):
        log.read()


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ("mug", "mug"),
        ("  tea mug ", "tea mug"),
        ("Scha\u0308le", "Schäle"),
        ("👩‍🍳", "👩‍🍳"),
        ("x" * LONGEST, "x" * LONGEST),
    ],
)
def test_a_name_is_kept_without_blanks_and_composed(given: str, kept: str) -> None:
    assert check_concept_name(given) == kept


@pytest.mark.parametrize("given", ["", "  ", "a\nb", "a\x00b", "a\u202eb", "\ud800", "a\u2028b", "x" * (LONGEST + 1)])
def test_what_cannot_be_seen_or_is_too_long_is_no_name(given: str) -> None:
    with pytest.raises(InvalidParameter, match="name of a concept"):
        check_concept_name(given)
