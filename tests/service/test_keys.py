"""Access keys: what is stored, who is let in, and what damaged or foreign ones are worth."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from service.engine.errors import InvalidParameter, KeyNotFound, NotAuthenticated
from service.keys import KeyStore, authenticate
from service.scopes import SCOPES


@pytest.fixture
def keys(tmp_path: Path) -> KeyStore:
    return KeyStore(tmp_path)


def test_a_key_is_known_by_every_replica(keys: KeyStore, tmp_path: Path) -> None:
    text, key = keys.create("robot-7", ("answer",), rate=5, concurrency=2)
    assert authenticate(text, KeyStore(tmp_path).valid()) == key
    assert (key.name, key.scopes, key.rate, key.concurrency) == ("robot-7", ("answer",), 5, 2)


def test_the_limits_of_a_key_are_kept(keys: KeyStore, tmp_path: Path) -> None:
    text, _ = keys.create("robot-7", ("answer",), max_body=4096, max_points=300, max_batch=2)
    key = authenticate(text, KeyStore(tmp_path).valid())
    assert (key.max_body, key.max_points, key.max_batch) == (4096, 300, 2)


def test_a_key_of_before_there_were_such_limits_goes_on_without_them(keys: KeyStore, tmp_path: Path) -> None:
    text, key = keys.create("robot-7", ("answer",), rate=5)
    file = tmp_path / "keys" / f"{key.id}.json"
    stored = json.loads(file.read_text())
    file.write_text(json.dumps({name: value for name, value in stored.items() if not name.startswith("max_")}))
    old = authenticate(text, KeyStore(tmp_path).valid())
    assert (old.rate, old.max_body, old.max_points, old.max_batch) == (5, None, None, None)


def test_the_secret_is_nowhere_in_the_store(keys: KeyStore, tmp_path: Path) -> None:
    text, _ = keys.create("robot-7", SCOPES)
    secret = text.split("_", 2)[2].encode()
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert files
    assert not any(secret in path.read_bytes() for path in files)


def test_no_two_keys_are_alike(keys: KeyStore) -> None:
    made = [keys.create("twin", ("answer",)) for _ in range(20)]
    assert len({text for text, _ in made}) == len({key.id for _, key in made}) == 20
    assert [key.id for key in keys.all()] == [key.id for key in sorted((k for _, k in made), key=lambda k: k.id)]


def test_a_revoked_key_is_worthless_for_good_and_others_are_not(keys: KeyStore, tmp_path: Path) -> None:
    (text, key), (other, _) = keys.create("gone", ("answer",)), keys.create("stays", ("answer",))
    keys.revoke(key.id)
    keys.revoke(key.id)
    valid = KeyStore(tmp_path).valid()
    with pytest.raises(NotAuthenticated):
        authenticate(text, valid)
    assert authenticate(other, valid).name == "stays"
    assert keys.revoked() == {key.id}
    assert len(keys.all()) == 2


def test_a_key_that_is_not_there_cannot_be_revoked(keys: KeyStore) -> None:
    with pytest.raises(KeyNotFound, match="keys list"):
        keys.revoke("0123456789ab")


def test_texts_that_are_no_key_are_refused(keys: KeyStore) -> None:
    text, key = keys.create("robot-7", ("answer",))
    other, _ = keys.create("robot-8", ("answer",))
    flipped = text[:-2] + ("A" if text[-2] != "A" else "B") + text[-1]
    swapped = f"sc_{key.id}_{other.split('_', 2)[2]}"
    for wrong in (
        "",
        "x",
        text[:-1],
        text + "A",
        flipped,
        swapped,
        text.upper(),
        "sc_" + "é" * 40,
        "\ud800",
        "a" * 10**6,
    ):
        with pytest.raises(NotAuthenticated):
            authenticate(wrong, keys.valid())


@pytest.mark.parametrize(
    ("name", "scopes", "limits"),
    [
        ("", ("answer",), {}),
        ("a" * 101, ("answer",), {}),
        ("x", (), {}),
        ("x", ("answer",), {"rate": 0}),
        ("x", ("answer",), {"rate": float("nan")}),
        ("x", ("answer",), {"concurrency": 0}),
        ("x", ("answer",), {"max_body": 1023}),
        ("x", ("answer",), {"max_points": 99}),
        ("x", ("answer",), {"max_batch": 0}),
    ],
)
def test_a_key_that_makes_no_sense_is_not_made(keys: KeyStore, name: str, scopes: tuple, limits: dict) -> None:
    with pytest.raises(InvalidParameter):
        keys.create(name, scopes, **limits)
    assert keys.all() == []


def test_a_damaged_key_lets_nobody_in_and_keeps_nobody_out(keys: KeyStore, tmp_path: Path) -> None:
    (text, key), (other, _) = keys.create("cut", ("answer",)), keys.create("whole", ("answer",))
    file = tmp_path / "keys" / f"{key.id}.json"
    for content in ("", "{}", json.dumps(json.loads(file.read_text()) | {"scopes": ["everything"]})):
        file.write_text(content)
        valid = KeyStore(tmp_path).valid()
        with pytest.raises(NotAuthenticated):
            authenticate(text, valid)
        assert authenticate(other, valid).name == "whole"
