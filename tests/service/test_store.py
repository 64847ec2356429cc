"""Versions never change, none is lost and none is half there, in a folder and in a bucket."""

from __future__ import annotations

import multiprocessing
import random
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from service.engine.errors import InvalidParameter, ModelDamaged, ModelNotFound
from service.engine.model import ShapeModel
from service.model_file import encode, read_manifest, sha256
from service.store import ModelStore


def publish(store: ModelStore, model: ShapeModel, name: str = "tiny", alias: str | None = "production") -> int:
    return store.publish(model, name=name, seed=7, source={"simulated": 8}, alias=alias).version


def test_what_is_published_is_loaded_bit_for_bit(url: str, model: ShapeModel) -> None:
    store = ModelStore(url)
    manifest = store.publish(model, name="tiny", seed=7, source={"simulated": 8})
    loaded, found = ModelStore(url).load("tiny", 1)
    assert encode(loaded) == encode(model)
    assert found == manifest
    assert (found.name, found.version, found.seed, found.source) == ("tiny", 1, 7, {"simulated": 8})
    assert found.params == model.params
    assert found.counts == model.facts()["counts"]


def test_versions_count_up_for_each_name_alone(url: str, model: ShapeModel) -> None:
    store = ModelStore(url)
    assert [publish(store, model, name) for name in ("a", "b", "a", "a-b")] == [1, 1, 2, 1]
    assert store.names() == ["a", "a-b", "b"]
    assert store.versions("a") == [1, 2]
    assert store.versions("nobody") == []


def test_an_alias_has_a_history_and_can_go_back_through_it(url: str, model: ShapeModel) -> None:
    store = ModelStore(url)
    for _ in range(3):
        publish(store, model)
    assert store.rollback("tiny") == 2
    assert store.rollback("tiny") == 1
    with pytest.raises(InvalidParameter, match="nothing before"):
        store.rollback("tiny")
    store.promote("tiny", 3)
    store.promote("tiny", 3)
    assert store.rollback("tiny") == 1
    history = store.alias_history("tiny")
    assert [(entry.version, entry.action) for entry in history] == [
        (1, "promote"),
        (2, "promote"),
        (3, "promote"),
        (2, "rollback"),
        (1, "rollback"),
        (3, "promote"),
        (1, "rollback"),
    ]
    assert store.aliases("tiny") == {"production": 1}


def test_a_rollback_that_is_repeated_is_done_once(url: str, model: ShapeModel) -> None:
    store = ModelStore(url)
    for _ in range(3):
        publish(store, model)
    assert [store.rollback("tiny", leaving=3) for _ in range(3)] == [2, 2, 2]
    assert len(store.alias_history("tiny")) == 4
    assert store.rollback("tiny", leaving=2) == 1
    with pytest.raises(InvalidParameter, match="nothing before"):
        store.rollback("tiny", leaving=1)
    with pytest.raises(ModelNotFound, match="nobody"):
        store.rollback("tiny", "nobody", leaving=1)


def test_the_names_of_a_version_are_kept_beside_it(url: str, model: ShapeModel) -> None:
    store = ModelStore(url)
    for _ in range(2):
        publish(store, model)
    first = store.concept_names("tiny", 1)
    for number in range(12):
        held = first.read()
        assert first.change({20: f"mug {number}"}).changes == held.changes + 1
        assert first.read(held) == first.read()
    assert store.concept_names("tiny", 1).read().of == {20: "mug 11"}
    assert store.concept_names("tiny", 2).read().of == {}
    assert store.versions("tiny") == [1, 2]


def test_references_are_resolved_by_the_documented_grammar(url: str, model: ShapeModel) -> None:
    store = ModelStore(url)
    publish(store, model)
    publish(store, model, alias="staging")
    publish(store, model, alias=None)
    assert store.resolve("tiny") == store.resolve("tiny@production") == store.resolve("tiny:1") == ("tiny", 1)
    assert store.resolve("tiny@staging") == ("tiny", 2)
    assert store.resolve("tiny:3") == ("tiny", 3)
    for reference in ("tiny:4", "tiny@nobody", "nobody"):
        with pytest.raises(ModelNotFound, match="tiny"):
            store.resolve(reference)
    for reference in ("", "Tiny", "tiny:", "tiny@", "tiny:1@x", "tiny:x", "../tiny", "tiny/1", "-tiny", "tiny:1\n"):
        with pytest.raises(InvalidParameter):
            store.resolve(reference)


def test_a_bare_name_without_production_says_which_versions_there_are(url: str, model: ShapeModel) -> None:
    store = ModelStore(url)
    publish(store, model, alias=None)
    with pytest.raises(ModelNotFound, match=r"the versions 1 .*tiny:1"):
        store.resolve("tiny")


def test_racing_publishers_lose_no_version(url: str, model: ShapeModel) -> None:
    with ThreadPoolExecutor(8) as threads:
        versions = list(threads.map(lambda _: publish(ModelStore(url), model), range(16)))
    store = ModelStore(url)
    assert sorted(versions) == store.versions("tiny") == list(range(1, 17))
    assert store.aliases("tiny") == {"production": 16}
    for version in versions:
        assert encode(store.load("tiny", version)[0]) == encode(model)


def _publish_often(folder: Path, times: int) -> None:
    store = ModelStore(folder)
    model, _ = store.load("tiny", 1)
    for _ in range(times):
        publish(store, model)


def test_racing_processes_lose_no_version(store: ModelStore) -> None:
    context = multiprocessing.get_context("spawn")
    processes = [context.Process(target=_publish_often, args=(Path(store.url), 10)) for _ in range(3)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    assert store.versions("tiny") == list(range(1, 32))
    for version in store.versions("tiny"):
        store.load("tiny", version)


def test_a_publisher_killed_in_the_middle_leaves_no_half_version(store: ModelStore, model: ShapeModel) -> None:
    endless = f"""
from pathlib import Path
from tests.service.test_store import _publish_often
print("ready", flush=True)
_publish_often(Path({store.url!r}), 10**6)
"""
    for attempt in range(3):
        with subprocess.Popen([sys.executable, "-c", endless], stdout=subprocess.PIPE) as process:
            assert process.stdout is not None
            process.stdout.readline()
            time.sleep(0.1 + random.Random(attempt).random() / 2)
            process.kill()
        versions = store.versions("tiny")
        assert versions == list(range(1, len(versions) + 1))
        for version in {1, versions[-1], len(versions) // 2 + 1}:
            assert encode(store.load("tiny", version)[0]) == encode(model)
        assert publish(store, model) == len(versions) + 1


def test_a_damaged_version_is_refused_and_the_others_are_not(store: ModelStore, model: ShapeModel) -> None:
    folder = Path(store.url)
    publish(store, model, "other")
    manifest = folder / "models" / "tiny" / "versions" / "00000001.json"
    whole = manifest.read_bytes()
    manifest.write_bytes(whole[:-40])
    with pytest.raises(ModelDamaged, match="cut off"):
        store.load("tiny", 1)
    manifest.write_bytes((folder / "models" / "other" / "versions" / "00000001.json").read_bytes())
    with pytest.raises(ModelDamaged, match="other:1"):
        store.load("tiny", 1)
    manifest.write_bytes(whole)
    store.load("tiny", 1)
    (blob,) = (folder / "blobs" / "sha256").iterdir()
    altered = bytearray(blob.read_bytes())
    altered[-5] ^= 1
    blob.write_bytes(altered)
    with pytest.raises(ModelDamaged, match=r"tiny:1 is refused.*altered"):
        store.load("tiny", 1)
    with pytest.raises(ModelDamaged):
        store.export("tiny", 1, folder / "exported")
    assert not (folder / "exported").exists()
    blob.unlink()
    with pytest.raises(ModelDamaged, match="missing"):
        store.load("tiny", 1)
    publish(store, model)
    store.load("tiny", 1)


def test_an_alias_entry_that_was_altered_is_told(store: ModelStore) -> None:
    entry = Path(store.url) / "models" / "tiny" / "aliases" / "production" / "00000001.json"
    for content in (b"", b"[]", b'{"version": "x"}'):
        entry.write_bytes(content)
        with pytest.raises(ModelDamaged, match="alias"):
            store.resolve("tiny")


def test_an_export_is_byte_for_byte_what_is_stored(url: str, model: ShapeModel, tmp_path: Path) -> None:
    store = ModelStore(url)
    manifest = store.publish(model, name="tiny", seed=7, source={})
    files = store.export("tiny", 1, tmp_path / "deep" / "exported")
    assert [path.name for path in files] == ["manifest.json", "model.safetensors"]
    assert files[1].read_bytes() == encode(model)
    assert read_manifest(files[0].read_bytes()) == manifest
    assert manifest.contents["model.safetensors"].sha256 == sha256(files[1].read_bytes())


@pytest.mark.parametrize("name", ["", "Tiny", "a b", "a/b", "..", "-a", "a" * 64, "ä"])
def test_a_name_of_another_form_is_refused(store: ModelStore, model: ShapeModel, name: str) -> None:
    with pytest.raises(InvalidParameter):
        publish(store, model, name)
    with pytest.raises(InvalidParameter):
        publish(store, model, "tiny", alias=name)
    assert store.versions("tiny") == [1]


def test_only_versions_that_exist_can_be_promoted(store: ModelStore) -> None:
    with pytest.raises(ModelNotFound, match="no version 2"):
        store.promote("tiny", 2)
    with pytest.raises(ModelNotFound):
        store.rollback("tiny", "nobody")


def test_what_is_published_once_by_many_at_a_time_is_one_version(url: str, model: ShapeModel) -> None:
    """As when a worker that was taken for dead goes on beside the one that took its job over."""
    made: dict[str, object] = {"name": "tiny", "seed": 7, "source": {}, "job": "nightly", "once": "nightly-1"}

    def publish_either(turn: int) -> int:
        if turn % 4 == 0:  # others take numbers meanwhile
            return -publish(ModelStore(url), model, alias=None)
        return ModelStore(url).publish(model, **made).version  # type: ignore[arg-type]

    with ThreadPoolExecutor(8) as threads:
        taken = list(threads.map(publish_either, range(16)))
    assert len({version for version in taken if version > 0}) == 1
    store = ModelStore(url)
    assert store.versions("tiny") == [1, 2, 3, 4, 5]
    assert [store.manifest("tiny", version).job for version in store.versions("tiny")].count("nightly") == 1


def test_parent_and_metrics_are_kept_and_absent_where_they_were_not_told(url: str, model: ShapeModel) -> None:
    store = ModelStore(url)
    publish(store, model)
    told = store.publish(model, name="tiny", seed=7, source={}, parent="tiny:1", metrics={"knn": 0.75})
    found = store.manifest("tiny", 2)
    assert (found.parent, found.metrics) == (told.parent, told.metrics) == ("tiny:1", {"knn": 0.75})
    assert not {"parent", "metrics", "job"} & set(store.manifest("tiny", 1).model_dump())


def test_an_alias_is_exchanged_only_while_it_means_what_was_expected(tmp_path: Path, model: ShapeModel) -> None:
    store = ModelStore(tmp_path)
    for _ in range(3):
        store.publish(model, name="m", seed=1, source={}, alias=None)
    assert store.exchange("m", None, 1)
    assert store.exchange("m", 1, 2)
    assert not store.exchange("m", 1, 3)
    assert store.exchange("m", 1, 2)  # it is so already
    assert [entry.version for entry in store.alias_history("m")] == [1, 2]
    assert store.rollback("m") == 1
