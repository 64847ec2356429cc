"""The use cases on datasets, in a folder and in a bucket."""

from __future__ import annotations

import io
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from service.archives import Archive
from service.clouds import Viewpoint
from service.dataset_cases import DatasetCases, Reading, names_dataset
from service.dataset_records import Verdict
from service.datasets import Datasets
from service.engine.errors import DatasetInUse, StoreUnavailable, UnreadableArchive
from service.engine.model import ShapeModel
from service.labels import Label
from service.settings import Settings
from service.store import ModelStore
from tests.service.test_archives import NOW, packed, tar
from tests.service.test_datasets import ply

POSE = Viewpoint((0.0, 0.0, -0.1))


@pytest.fixture
def cases(url: str) -> DatasetCases:
    cases = DatasetCases(ModelStore(url), Settings(store=url))
    cases.store.create("mugs")
    return cases


def outcomes(verdicts: Iterator[Verdict]) -> list[tuple[str, str]]:
    return [(verdict.key, verdict.outcome) for verdict in verdicts]


def test_an_archive_that_is_interrupted_is_sent_again_and_only_what_is_missing_is_stored(cases: DatasetCases) -> None:
    file = io.BytesIO(packed([(f"{n}.ply", ply(n)) for n in range(6)], "zip"))
    verdicts = cases.unpack("mugs", file, Reading())
    assert [next(verdicts).outcome for _ in range(2)] == ["accepted"] * 2
    verdicts.close()
    assert cases.store.keys("mugs") == ["0.ply", "1.ply"]
    told = [outcome for _, outcome in outcomes(cases.unpack("mugs", file, Reading()))]
    assert told == ["already-there"] * 2 + ["accepted"] * 4


def test_what_is_packed_is_the_same_dataset_when_it_is_unpacked(cases: DatasetCases) -> None:
    cases.put("mugs", "a.ply", ply(1), Reading("m", POSE), label=Label(category="mug", view="front"))
    cases.put("mugs", "deep/b", ply(2), Reading())  # a key that tells no format
    cases.put(
        "mugs",
        ".points.json",
        b"[" + b",".join(b"[%f,0.1,0.5]" % (0.001 * n) for n in range(150)) + b",[0,0,0.5]]",
        Reading(),
    )
    cases.put("mugs", "c.ply", ply(3), Reading(), label=Label(category="bowl"))
    for kind in ("zip", "tar.gz"):
        snapshot = cases.snapshot("mugs")
        archive = io.BytesIO(b"".join(cases.pack(snapshot, kind)))  # type: ignore[arg-type]
        cases.store.create(f"copy-{kind[:3]}")
        told = dict(outcomes(cases.unpack(f"copy-{kind[:3]}", archive, Reading())))
        assert told["a.ply"] == told["deep/b"] == "accepted"
        copy = cases.snapshot(f"copy-{kind[:3]}")
        assert [entry.model_copy(update={"added": NOW}) for entry in copy.clouds] == [
            entry.model_copy(update={"added": NOW}) for entry in snapshot.clouds
        ]


def test_an_archive_that_lies_about_its_clouds_spoils_nothing(cases: DatasetCases) -> None:
    for about in (b"", b"[]", b"{", b'{"clouds": [{"key": "a.ply"}]}', b"\xff"):
        archive = io.BytesIO(packed([("dataset.json", about), ("a.ply", ply(1))], "tar.gz"))
        assert outcomes(cases.unpack("mugs", archive, Reading()))[0] == ("dataset.json", "left-out")
    assert cases.store.read("mugs", "a.ply") == ply(1)


def test_a_hostile_archive_leaves_nothing(cases: DatasetCases) -> None:
    link = io.BytesIO(packed([("a.ply", ply(1))], "tar.gz") + b"")
    good = link.getvalue()
    for data in (good[:-20], packed([("a.ply", ply(1)), ("../b.ply", ply(2))], "zip"), tar()[:100]):
        with pytest.raises(UnreadableArchive):
            list(cases.unpack("mugs", io.BytesIO(data), Reading()))
    assert cases.store.keys("mugs") == []


def test_a_dataset_that_a_model_names_is_kept(cases: DatasetCases, model: ShapeModel) -> None:
    part = {"kind": "dataset", "name": "mugs", "digest": "0", "clouds": 1}
    models = ModelStore(cases.store.url)
    models.publish(model, name="m", seed=1, source={"kind": "joined", "parts": [{"kind": "joined", "parts": [part]}]})
    cases.store.create("other")
    cases.delete("other")
    with pytest.raises(DatasetInUse, match="m:1"):
        cases.delete("mugs")
    cases.delete("mugs", force=True)
    assert cases.store.names() == []


def test_only_a_dataset_of_that_name_is_named() -> None:
    assert names_dataset({"kind": "dataset", "name": "a"}, "a")
    for source in ({"kind": "dataset", "name": "b"}, {"kind": "folder", "name": "a"}, {}, None, {"parts": "a"}):
        assert not names_dataset(source, "a")


def test_a_folder_is_taken_as_an_archive_of_it_is(cases: DatasetCases, tmp_path: Path) -> None:
    files = [("a.ply", ply(1)), ("deep/labels.csv", b"file,category\nb.ply,mug\n"), ("deep/b.ply", ply(2))]
    files += [("deep/torn.ply", b"ply"), ("x.png", b""), (".git/a.ply", ply(3))]
    for name, data in files:
        (tmp_path / "scans" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "scans" / name).write_bytes(data)
    cases.store.create("other")
    one = outcomes(cases.take_folder("mugs", tmp_path / "scans", Reading()))
    other = outcomes(cases.unpack("other", io.BytesIO(packed(files, "zip")), Reading()))
    assert sorted(one) == sorted(other)
    assert cases.store.entries("mugs")[1].label == Label(category="mug")
    assert cases.store.digest("mugs") == cases.store.digest("other")


def test_a_large_archive_is_never_in_memory(tmp_path: Path) -> None:
    cases = DatasetCases(ModelStore(tmp_path), Settings(store=str(tmp_path)))
    cases.store.create("mugs")
    with (tmp_path / "large.tar.gz").open("w+b") as file:
        for n in range(40):
            points = np.random.default_rng(n).uniform((-0.05, -0.05, 0.45), (0.05, 0.05, 0.55), (2 * 10**4, 3))
            cloud = io.BytesIO()
            np.save(cloud, points)
            cases.store.add("mugs", f"{n}.npy", cloud.getvalue())
        tracemalloc.start()
        file.writelines(cases.pack(cases.snapshot("mugs"), "tar.gz"))
        assert Archive(file, cases.bounds).check() == 41
        cases.store.create("copy")
        told = outcomes(cases.unpack("copy", file, Reading()))
        assert len(told) == 41
        size, peak = file.seek(0, 2), tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert size > 1.6e7
    assert peak < 0.8e7


def test_a_disk_that_cannot_be_written_is_told(cases: DatasetCases, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", "/proc/nowhere")
    with pytest.raises(StoreUnavailable, match="/proc/nowhere"), cases.spooled():
        pass


def test_clouds_are_limited_by_the_settings_and_by_the_key(tmp_path: Path) -> None:
    cases = DatasetCases(ModelStore(tmp_path), Settings(store=str(tmp_path), max_points=149))
    cases.store.create("mugs")
    files = io.BytesIO(packed([("a.ply", ply(1))], "zip"))
    (verdict,) = cases.unpack("mugs", files, Reading(max_points=10**6))
    assert verdict.error is not None
    assert verdict.error.type == "too-many-points"
    assert Datasets(tmp_path).keys("mugs") == []
