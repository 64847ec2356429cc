"""The few operations on a folder or bucket, and how their failures are told."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from service.engine.errors import StoreUnavailable
from service.objects import STALE, Objects


def test_what_is_created_once_is_never_replaced(tmp_path: Path) -> None:
    objects = Objects(tmp_path)
    assert objects.create("a/b.json", b"first")
    assert not objects.create("a/b.json", b"second")
    assert objects.get("a/b.json") == b"first"


def test_a_folder_is_made_only_when_something_is_written(tmp_path: Path) -> None:
    objects = Objects(tmp_path / "deep" / "store")
    assert objects.keys("a") == objects.folders("a") == objects.numbers("a") == []
    with pytest.raises(FileNotFoundError):
        objects.get("a")
    assert not (tmp_path / "deep").exists()
    objects.put("a/b", b"x")
    assert objects.keys("a") == ["a/b"]


@pytest.mark.parametrize("form", ["{}", "file://{}"])
def test_a_path_and_its_file_url_are_the_same_folder(tmp_path: Path, form: str) -> None:
    folder = tmp_path / "with blanks" / "and ümlaut"
    Objects(folder).put("a/b", b"x")
    assert Objects(form.format(folder)).get("a/b") == b"x"
    assert Objects(folder.as_uri()).get("a/b") == b"x"


def test_many_objects_are_written_listed_read_and_removed(url: str) -> None:
    objects = Objects(url)
    assert objects.listing("many") == []
    assert objects.find("many/0") is None
    objects.discard(["many/0"])
    written = [(f"many/{number:03}", bytes(number)) for number in range(300)]
    objects.put_each(written)
    assert [(found.key, found.size) for found in objects.listing("many")] == [(key, len(d)) for key, d in written]
    assert list(objects.get_each([key for key, _ in written])) == [data for _, data in written]
    assert list(objects.get_each(["many/007", "many/nobody"])) == [bytes(7), None]
    found = objects.find("many/299")
    assert found is not None
    assert (found.size, found in objects.listing("many")) == (299, True)
    objects.discard(["many/nobody", *(key for key, _ in written[1:])])
    assert objects.keys("many") == ["many/000"]
    objects.remove("many")
    objects.remove("many")
    assert objects.keys("many") == []


def test_only_numbered_entries_count(tmp_path: Path) -> None:
    objects = Objects(tmp_path)
    for number in (3, 1):
        assert objects.create_number("log", number, b"")
    objects.put("log/notes.txt", b"")
    objects.put("log/1.json", b"")
    assert objects.numbers("log") == [1, 3]


def test_what_a_killed_writer_left_is_swept_once_it_is_old(tmp_path: Path) -> None:
    objects = Objects(tmp_path)
    objects.put("blobs/kept", b"x")
    old, young = tmp_path / "blobs" / "dead#1", tmp_path / "blobs" / "alive#2"
    for path in (old, young):
        path.write_bytes(b"half")
    os.utime(old, (time.time() - 2 * STALE,) * 2)
    assert objects.keys("blobs") == ["blobs/kept"]
    objects.sweep()
    assert not old.exists()
    assert young.exists()


@pytest.mark.parametrize("url", ["ftp://host/models", "nonsense://x"])
def test_an_unknown_kind_of_store_is_refused_by_name(url: str) -> None:
    with pytest.raises(StoreUnavailable, match=url):
        Objects(url)


def test_a_store_that_is_a_file_is_unavailable(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    objects = Objects(tmp_path / "file")
    with pytest.raises(StoreUnavailable, match="read"):
        objects.keys("a")
    with pytest.raises(StoreUnavailable, match="written"):
        objects.put("a", b"")


def test_a_bucket_out_of_reach_is_told_within_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "nobody")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "nothing")
    began = time.monotonic()
    with pytest.raises(StoreUnavailable, match="s3://models") as caught:
        Objects("s3://models/prefix").keys("a")
    assert "\n" not in str(caught.value)
    assert time.monotonic() - began < 20
