"""Each content is stored once, each key means one cloud, and none is lost or half there: in a folder, in a bucket."""

from __future__ import annotations

import os
import random
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from service.clouds import Viewpoint, write_ply
from service.dataset_records import Entry, digest_of
from service.datasets import BLOBS, UNDER_WAY, Datasets
from service.engine.cloud import PointCloud
from service.engine.errors import (
    CloudExists,
    CloudNotFound,
    DatasetDamaged,
    DatasetExists,
    DatasetNotFound,
    InvalidParameter,
)
from service.labels import Label
from service.objects import Objects

MUG, BOWL = Label(category="mug", group="g"), Label(category="bowl")
AT_ONCE = timedelta(seconds=-60)


def ply(seed: int) -> bytes:
    """A cloud that can be learnt from: points of a box, half a metre before the sensor."""
    points = np.random.default_rng(seed).uniform((-0.05, -0.05, 0.45), (0.05, 0.05, 0.55), (150, 3))
    return write_ply(PointCloud(points.astype(np.float32)))


def age(datasets: Datasets) -> None:
    """Makes the contents of a folder look as if they had been there for long."""
    for blob in (Path(datasets.url) / BLOBS).iterdir():
        os.utime(blob, (time.time() - 2 * UNDER_WAY.total_seconds(),) * 2)


def blobs(datasets: Datasets) -> list[str]:
    return [key.rpartition("/")[2] for key in Objects(datasets.url).keys(BLOBS)]


@pytest.fixture
def datasets(url: str) -> Datasets:
    datasets = Datasets(url)
    datasets.create("mugs", "of the kitchen")
    return datasets


@pytest.fixture
def local(tmp_path: Path) -> Datasets:
    datasets = Datasets(tmp_path / "store")
    datasets.create("mugs")
    return datasets


def test_a_cloud_is_read_byte_for_byte_as_it_was_sent(datasets: Datasets) -> None:
    for key in ("a.ply", "kitchen/mug 7 (blue)/ä=~%#.ply", "kitchen/mug", "kitchen/mug/0.ply"):
        verdict = datasets.add("mugs", key, ply(len(key)))
        assert (verdict.outcome, verdict.error) == ("accepted", None)
        assert verdict.sha256 == sha256(ply(len(key))).hexdigest()
        assert Datasets(datasets.url).read("mugs", key) == ply(len(key))
    entries = datasets.entries("mugs")
    assert [entry.key for entry in entries] == sorted(datasets.keys("mugs"))
    assert len(entries) == 4
    assert {(entry.format, entry.bytes, entry.points) for entry in entries} == {("ply", len(ply(0)), 150)}


def test_the_same_bytes_are_stored_once_whatever_they_are_called(datasets: Datasets) -> None:
    datasets.create("more")
    for name, key in (("mugs", "a.ply"), ("mugs", "b/a.ply"), ("more", "x.ply")):
        assert datasets.add(name, key, ply(1)).outcome == "accepted"
    assert blobs(datasets) == [sha256(ply(1)).hexdigest()]


def test_a_key_means_one_cloud_unless_it_is_to_be_replaced(datasets: Datasets) -> None:
    assert datasets.add("mugs", "a.ply", ply(1)).outcome == "accepted"
    assert datasets.add("mugs", "a.ply", ply(1)).outcome == "already-there"
    refused = datasets.add("mugs", "a.ply", ply(2))
    assert refused.outcome == "refused"
    assert refused.error is not None
    assert refused.error.type == "cloud-exists"
    with pytest.raises(CloudExists):
        datasets.put("mugs", "a.ply", ply(1), unit="in")  # the same bytes, but another cloud
    assert datasets.read("mugs", "a.ply") == ply(1)
    assert datasets.add("mugs", "a.ply", ply(2), replace=True).outcome == "replaced"
    assert datasets.add("mugs", "a.ply", ply(2), replace=True).outcome == "already-there"
    assert datasets.read("mugs", "a.ply") == ply(2)


@pytest.mark.parametrize(
    ("data", "type"),
    [
        (b"", "empty-cloud"),
        (b"ply\n", "unreadable-cloud"),
        (ply(1)[:-7], "unreadable-cloud"),
        (b"\x00\x01\x02", "unsupported-format"),
        (b"\x89PNG\r\n\x1a\n", "unsupported-format"),
        (b"0 0 1\n1 1 1\n", "too-few-points"),
        (b"".join(b"%d 0 1\n" % i for i in range(200)), "implausible-extent"),
    ],
)
def test_what_cannot_be_learnt_from_is_refused_and_leaves_nothing(local: Datasets, data: bytes, type: str) -> None:
    verdict = local.add("mugs", "a", data)
    assert (verdict.outcome, verdict.sha256) == ("refused", None)
    assert verdict.error is not None
    assert (verdict.error.type, bool(verdict.error.detail)) == (type, True)
    assert local.entries("mugs") == []
    assert blobs(local) == []


@pytest.mark.parametrize(
    "key",
    [
        *("", "/etc/passwd", "../a", "a/../../b", "a//b", "a/", "./a", "a\\..\\b", "a\nb", "a\x00", "\udc80"),
        *("x" * 241, "ä" * 90, "/".join(["a" * 200] * 4)),
    ],
)
def test_a_key_that_is_no_path_within_is_refused(local: Datasets, key: str) -> None:
    verdict = local.add("mugs", key, ply(1))
    assert verdict.error is not None
    assert (verdict.outcome, verdict.error.type) == ("refused", "invalid-parameter")
    with pytest.raises(InvalidParameter):
        local.read("mugs", key)
    assert local.keys("mugs") == []


def test_unit_and_viewpoint_stay_with_the_cloud_and_are_part_of_the_digest(local: Datasets) -> None:
    pose = Viewpoint((0.0, 0.0, -0.1), (0.5, 0.5, 0.5, 0.5))
    plain = local.digest("mugs")
    local.add("mugs", "a.ply", ply(1))
    before = local.digest("mugs")
    local.add("mugs", "a.ply", ply(1), viewpoint=pose, replace=True)
    (entry,) = local.entries("mugs")
    assert (entry.pose(), entry.unit) == (pose, None)
    assert len({plain, before, local.digest("mugs")}) == 3
    assert digest_of(local.entries("mugs")) == local.digest("mugs")


def test_labels_stand_apart_from_clouds(datasets: Datasets) -> None:
    datasets.add("mugs", "a.ply", ply(1), label=MUG)
    datasets.add("mugs", "b.ply", ply(2))
    datasets.add("mugs", "c.ply", ply(3))
    digest = datasets.digest("mugs")
    assert datasets.label("mugs", {"b.ply": BOWL, "nobody.ply": BOWL}) == ["nobody.ply"]
    assert [entry.label for entry in datasets.entries("mugs")] == [MUG, BOWL, None]
    assert datasets.labels("mugs") == {"a.ply": MUG, "b.ply": BOWL}
    assert datasets.digest("mugs") == digest
    assert datasets.show("mugs").categories == {"bowl": 1, "mug": 1}


def test_pages_make_up_the_whole(datasets: Datasets) -> None:
    for number in range(7):
        datasets.add("mugs", f"{number % 3}/{number}.ply", ply(number), label=MUG)
    found: list[Entry] = []
    while page := datasets.page("mugs", found[-1].key if found else "", 3):
        assert len(page) <= 3
        found += page
    assert found == datasets.entries("mugs")


def test_a_dataset_is_made_once_and_shown(datasets: Datasets) -> None:
    assert datasets.create("mugs").description == "of the kitchen"
    assert datasets.create("mugs", "of the kitchen") == datasets.about("mugs")
    with pytest.raises(DatasetExists, match="kitchen"):
        datasets.create("mugs", "of the office")
    datasets.create("empty")
    datasets.add("mugs", "a.ply", ply(1))
    assert datasets.names() == ["empty", "mugs"]
    shown = datasets.show("mugs")
    assert (shown.clouds, shown.bytes, shown.formats) == (1, len(ply(1)), {"ply": 1})
    assert shown.digest == datasets.digest("mugs") != datasets.digest("empty")
    for name in ("Mugs", "../x", "", "a" * 64):
        with pytest.raises(InvalidParameter):
            datasets.create(name)


def test_what_is_not_there_is_said(datasets: Datasets) -> None:
    for ask in (datasets.show, datasets.entries, datasets.digest, datasets.delete):
        with pytest.raises(DatasetNotFound, match="mugs"):
            ask("nobody")
    with pytest.raises(DatasetNotFound):
        datasets.add("nobody", "a.ply", ply(1))
    with pytest.raises(CloudNotFound, match="nobody"):
        datasets.read("mugs", "nobody.ply")


def test_deleting_frees_what_no_other_dataset_has(datasets: Datasets) -> None:
    datasets.create("more")
    for name, seeds in (("mugs", (1, 2)), ("more", (2, 3))):
        for seed in seeds:
            datasets.add(name, f"{seed}.ply", ply(seed), label=MUG)
    datasets.delete("mugs")
    assert datasets.names() == ["more"]
    assert len(blobs(datasets)) == 3  # somebody may be about to name what was written a moment ago
    datasets.sweep(AT_ONCE)
    assert blobs(datasets) == sorted(sha256(ply(seed)).hexdigest() for seed in (2, 3))
    assert datasets.read("more", "2.ply") == ply(2)
    datasets.create("mugs")
    assert datasets.entries("mugs") == []
    assert datasets.labels("mugs") == {}


def test_what_nobody_names_any_more_goes_with_the_next_dataset_that_is_deleted(local: Datasets) -> None:
    local.add("mugs", "a.ply", ply(1))
    local.add("mugs", "a.ply", ply(2), replace=True)
    local.create("other")
    age(local)
    local.delete("other")
    assert blobs(local) == [sha256(ply(2)).hexdigest()]
    age(local)
    local.delete("mugs")
    assert blobs(local) == []


def test_uploads_at_the_same_time_lose_no_cloud(url: str) -> None:
    Datasets(url).create("mugs")
    stores = [Datasets(url) for _ in range(8)]
    jobs = [(stores[n % 8], f"{n % 20}.ply", ply(n % 20)) for n in range(80)]
    random.Random(1).shuffle(jobs)
    with ThreadPoolExecutor(8) as threads:
        verdicts = list(threads.map(lambda job: job[0].add("mugs", job[1], job[2]), jobs))
    assert sorted(v.outcome for v in verdicts) == ["accepted"] * 20 + ["already-there"] * 60
    assert len(stores[0].entries("mugs")) == len(blobs(stores[0])) == 20
    for number in range(20):
        assert stores[0].read("mugs", f"{number}.ply") == ply(number)


def test_of_different_clouds_sent_under_one_key_at_the_same_time_one_is_taken(url: str) -> None:
    Datasets(url).create("mugs")
    stores = [Datasets(url) for _ in range(8)]
    with ThreadPoolExecutor(8) as threads:
        verdicts = list(threads.map(lambda n: stores[n].add("mugs", "a.ply", ply(n)), range(8)))
    (taken,) = [verdict for verdict in verdicts if verdict.outcome == "accepted"]
    assert {v.error.type for v in verdicts if v.error} == {"cloud-exists"}
    assert sha256(stores[0].read("mugs", "a.ply")).hexdigest() == taken.sha256


def _add_for_ever(folder: str) -> None:
    datasets, number = Datasets(folder), 0
    while True:
        number += 1
        datasets.add("mugs", f"{random.random()}.ply", ply(number), label=MUG)


def test_an_upload_that_is_killed_leaves_nothing_half_written(local: Datasets) -> None:
    endless = f"from tests.service.test_datasets import _add_for_ever as go\ngo({local.url!r})"
    for attempt in range(3):
        with subprocess.Popen([sys.executable, "-c", endless]) as process:
            before, end = len(local.keys("mugs")), time.monotonic() + 60
            while len(local.keys("mugs")) < before + 3:
                assert time.monotonic() < end
                time.sleep(0.01)
            time.sleep(random.Random(attempt).random() / 10)
            process.kill()
        for entry in local.entries("mugs"):
            assert sha256(local.content(entry)).hexdigest() == entry.sha256


def test_what_was_altered_in_the_store_is_told(local: Datasets) -> None:
    local.add("mugs", "a.ply", ply(1))
    local.add("mugs", "b.ply", ply(2))
    folder = Path(local.url) / "datasets"
    blob = folder / "blobs" / "sha256" / sha256(ply(1)).hexdigest()
    blob.write_bytes(ply(3))
    with pytest.raises(DatasetDamaged, match="altered"):
        local.read("mugs", "a.ply")
    blob.unlink()
    with pytest.raises(DatasetDamaged, match="missing"):
        local.read("mugs", "a.ply")
    assert local.add("mugs", "a.ply", ply(1)).outcome == "replaced"  # sent again, it is whole again
    assert local.read("mugs", "a.ply") == ply(1)
    entry = folder / "sets" / "mugs" / "clouds" / "a.ply=.json"
    for content in (b"", b"{}", (entry.parent / "b.ply=.json").read_bytes()):
        entry.write_bytes(content)
        with pytest.raises(DatasetDamaged, match=r"a\.ply"):
            local.entries("mugs")
