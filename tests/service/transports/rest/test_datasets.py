"""Datasets over HTTP, by a real client of a real server."""

from __future__ import annotations

import csv
import io
import random
import socket
import tarfile
import threading
import time
import zipfile
from concurrent.futures import ThreadPoolExecutor
from hashlib import sha256
from pathlib import Path
from typing import Any

import httpx
import pytest

from service.application import Application
from service.archives import write
from service.engine.model import ShapeModel
from service.keys import KeyStore
from service.settings import Settings
from service.uploads import LEAST
from tests.service.test_archives import NOW, named, tar, zipped
from tests.service.test_datasets import ply

ROOT = "/v1/datasets/mugs"
LABELS = b"file,category\na.ply,mug\n"


@pytest.fixture
def made(client: httpx.Client) -> httpx.Client:
    """A client, once there is a dataset."""
    assert client.put(ROOT, json={"description": "of the kitchen"}).status_code == 200
    return client


def keys(client: httpx.Client) -> list[str]:
    return [cloud["key"] for cloud in client.get(f"{ROOT}/clouds", params={"limit": 1000}).json()["clouds"]]


def outcomes(response: httpx.Response) -> dict[str, str]:
    assert response.status_code == 200, response.text
    found = response.json()
    assert sum(found["outcomes"].values()) == len(found["verdicts"])
    return {verdict["key"]: verdict["outcome"] for verdict in found["verdicts"]}


def problem(response: httpx.Response) -> tuple[int, str]:
    assert response.headers["content-type"] == "application/problem+json"
    return response.status_code, response.json()["type"].rpartition(":")[2]


def test_a_cloud_goes_in_and_comes_out_byte_for_byte(made: httpx.Client) -> None:
    put = made.put(f"{ROOT}/clouds/kitchen/ä mug%25.ply", content=ply(1), params={"category": "mug", "group": "g"})
    assert put.status_code == 200, put.text
    assert put.json() == {
        "key": "kitchen/ä mug%.ply",
        "outcome": "accepted",
        "sha256": sha256(ply(1)).hexdigest(),
        "error": None,
    }
    got = made.get(f"{ROOT}/clouds/kitchen/ä mug%25.ply")
    assert (got.content, got.headers["content-type"]) == (ply(1), "model/ply")
    again = {"If-None-Match": got.headers["etag"]}
    assert made.get(f"{ROOT}/clouds/kitchen/ä mug%25.ply", headers=again).status_code == 304
    shown = made.get(ROOT).json()
    assert (shown["clouds"], shown["formats"], shown["categories"]) == (1, {"ply": 1}, {"mug": 1})
    assert made.get("/v1/datasets").json()["datasets"][0]["description"] == "of the kitchen"
    ((cloud),) = made.get(f"{ROOT}/clouds").json()["clouds"]
    assert (cloud["label"]["category"], cloud["label"]["group"]) == ("mug", "g")


@pytest.mark.parametrize(
    ("status", "kind", "path", "more"),
    [
        (409, "cloud-exists", "a.ply", {"content": ply(2)}),
        (400, "unreadable-cloud", "b.ply", {"content": ply(2)[:-9]}),
        (400, "unreadable-cloud", "b", {"content": ply(2), "headers": {"content-type": "model/x-pcd"}}),
        (415, "unsupported-format", "b", {"content": ply(2), "headers": {"content-type": "image/jpeg"}}),
        (415, "unsupported-format", "b", {"files": {"cloud": ply(2)}}),
        (422, "empty-cloud", "b", {"content": b""}),
        (422, "implausible-extent", "b", {"content": ply(2), "params": {"unit": "um"}}),
        (422, "invalid-parameter", "b", {"content": ply(2), "params": {"unit": "furlong"}}),
        (422, "invalid-parameter", "..%2f..%2fescaped.ply", {"content": ply(2)}),
        (422, "invalid-parameter", "%2Fetc%2Fpasswd", {"content": ply(2)}),
        (422, "invalid-parameter", "a%00.ply", {"content": ply(2)}),
        (422, "invalid-parameter", "a//b.ply", {"content": ply(2)}),
        (422, "invalid-parameter", "labels.csv", {"content": ply(2)}),
        (422, "invalid-parameter", "x" * 601, {"content": ply(2)}),
        (413, "content-too-large", "b", {"content": bytes(2**20 + 1)}),
    ],
)
def test_what_cannot_be_taken_is_a_problem_and_leaves_nothing(
    made: httpx.Client, settings: Settings, status: int, kind: str, path: str, more: dict[str, Any]
) -> None:
    assert made.put(f"{ROOT}/clouds/a.ply", content=ply(1)).json()["outcome"] == "accepted"
    assert problem(made.put(f"{ROOT}/clouds/{path}", **more)) == (status, kind)
    assert keys(made) == ["a.ply"]
    assert len(list(Path(settings.store, "datasets", "blobs", "sha256").iterdir())) == 1
    assert not list(Path(settings.store).parent.rglob("*escaped*"))


def test_a_dataset_is_made_with_or_without_a_description(made: httpx.Client) -> None:
    assert made.put("/v1/datasets/plain").json()["description"] == ""
    assert made.put(ROOT).json()["description"] == "of the kitchen"
    assert problem(made.put(ROOT, json={"description": "of the office"})) == (409, "dataset-exists")
    assert problem(made.put(ROOT, json={"colour": "blue"})) == (422, "invalid-parameter")
    assert problem(made.put(ROOT, content=b"hello", headers={"content-type": "text/plain"})) == (
        *(415, "unsupported-format"),
    )
    assert problem(made.put(ROOT, content=b"{", headers={"content-type": "application/json"}))[0] == 400


def test_replacing_has_to_be_asked_for(made: httpx.Client) -> None:
    for params, seed, outcome in (
        ({}, 1, "accepted"),
        ({}, 1, "already-there"),
        ({"replace": True}, 2, "replaced"),
        ({"replace": True}, 2, "already-there"),
    ):
        put = made.put(f"{ROOT}/clouds/a.ply", content=ply(seed), params=params)
        assert put.json()["outcome"] == outcome
    assert made.get(f"{ROOT}/clouds/a.ply").content == ply(2)


def test_of_clouds_sent_under_one_key_at_the_same_time_one_is_taken(made: httpx.Client, settings: Settings) -> None:
    with ThreadPoolExecutor(4) as threads:
        sent = list(threads.map(lambda n: made.put(f"{ROOT}/clouds/a.ply", content=ply(n)), range(4)))
    assert sorted(each.status_code for each in sent) == [200, 409, 409, 409]
    (taken,) = [n for n, each in enumerate(sent) if each.status_code == 200]
    assert made.get(f"{ROOT}/clouds/a.ply").content == ply(taken)


@pytest.mark.parametrize("kind", ["zip", "tar.gz"])
def test_an_archive_is_told_file_by_file_and_taken_once(made: httpx.Client, kind: Any) -> None:
    files = [
        ("scans/labels.csv", b"file,category,group\na.ply,mug,g\nnobody.ply,bowl,\n"),
        ("scans/a.ply", ply(1)),
        ("scans/deep/b.ply", ply(2)),
        ("scans/torn.ply", ply(3)[:-9]),
        ("scans/sheet.png", b"\x89PNG"),
        ("scans/._a.ply", b"finder"),
        ("README.md", b"hello"),
    ]
    body = b"".join(write(files, kind, NOW))
    first = made.post(f"{ROOT}/archive", content=body)
    assert outcomes(first) == {
        "scans/a.ply": "accepted",
        "scans/deep/b.ply": "accepted",
        "scans/torn.ply": "refused",
        "scans/sheet.png": "left-out",
        "scans/._a.ply": "left-out",
        "README.md": "left-out",
        "scans/labels.csv": "accepted",
    }
    told = {verdict["key"]: verdict["error"] for verdict in first.json()["verdicts"]}
    assert told["scans/torn.ply"]["type"] == "unreadable-cloud"
    assert "nobody.ply" in told["scans/labels.csv"]["detail"]
    again = outcomes(made.post(f"{ROOT}/archive", content=body))
    assert (again["scans/a.ply"], again["scans/torn.ply"]) == ("already-there", "refused")
    assert keys(made) == ["scans/a.ply", "scans/deep/b.ply"]
    assert made.get(ROOT).json()["categories"] == {"mug": 1}


@pytest.mark.parametrize("kind", ["zip", "tar.gz"])
def test_a_dataset_that_is_downloaded_makes_the_same_one_elsewhere(made: httpx.Client, kind: str) -> None:
    for seed in range(4):
        params = {"viewpoint": "0,0,-0.1", "unit": "m"} if seed == 2 else {"category": "mug"}
        assert made.put(f"{ROOT}/clouds/{seed}/mug.ply", content=ply(seed), params=params).status_code == 200
    packed = made.get(f"{ROOT}/archive", params={"format": kind})
    assert packed.status_code == 200
    with (
        zipfile.ZipFile(io.BytesIO(packed.content))
        if kind == "zip"
        else tarfile.open(fileobj=io.BytesIO(packed.content)) as archive
    ):
        names = archive.namelist() if isinstance(archive, zipfile.ZipFile) else archive.getnames()
    assert names == ["dataset.json", "labels.csv", "0/mug.ply", "1/mug.ply", "2/mug.ply", "3/mug.ply"]
    assert made.put("/v1/datasets/copy", json={}).status_code == 200
    assert outcomes(made.post("/v1/datasets/copy/archive", content=packed.content))["2/mug.ply"] == "accepted"
    one, other = made.get(ROOT).json(), made.get("/v1/datasets/copy").json()
    assert [one[part] for part in ("digest", "categories", "bytes")] == [
        other[part] for part in ("digest", "categories", "bytes")
    ]
    headers = {"If-None-Match": packed.headers["etag"]}
    assert made.get(f"{ROOT}/archive", params={"format": kind}, headers=headers).status_code == 304


def bombs() -> dict[str, bytes]:
    link = named("link.ply", type=tarfile.SYMTYPE, linkname="/etc/passwd")
    return {
        "ratio": zipped(("a.ply", bytes(2**26))),
        "truncated zip": zipped(("a.ply", ply(1)))[:-30],
        "truncated tar": b"".join(write([("a.ply", ply(1))], "tar.gz", NOW))[:-30],
        "traversal": zipped(("good.ply", ply(1)), ("../escaped.ply", ply(2))),
        "absolute": tar((named("good.ply"), ply(1)), (named("/tmp/escaped.ply"), ply(2))),
        "link": tar((named("good.ply"), ply(1)), (link, b"")),
        "no archive": ply(1),
        "nothing": b"",
        "tiny entries": zipped(*[(f"{n}.ply", b"") for n in range(1001)]),
        "unpacked": zipped(*[(f"{n}.bin", bytes(2**18) + ply(n) * 20) for n in range(40)]),
    }


class TestBounds:
    @pytest.fixture
    def settings(self, settings: Settings) -> Settings:
        return settings.model_copy(update={"max_entries": 1000, "max_unpacked": 2**23, "max_archive": 2**22})

    @pytest.mark.parametrize("name", bombs())
    def test_a_hostile_archive_is_refused_as_a_whole(self, made: httpx.Client, settings: Settings, name: str) -> None:
        response = made.post(f"{ROOT}/archive", content=bombs()[name])
        assert problem(response) in ((400, "unreadable-archive"), (413, "archive-too-large")), response.text
        assert keys(made) == []
        assert not list(Path(settings.store).rglob("blobs/sha256/*#*"))
        assert not list(Path(settings.store).parent.rglob("*escaped*"))

    def test_a_body_beyond_the_limit_is_not_kept(self, made: httpx.Client, application: Application) -> None:
        def endless() -> Any:
            for _ in range(100):
                yield bytes(2**16)

        assert problem(made.post(f"{ROOT}/archive", content=endless())) == (413, "content-too-large")
        assert application.datasets.room.held == 0

    def test_thousands_of_tiny_clouds_are_told_one_by_one(self, made: httpx.Client) -> None:
        files = [(f"{n}.xyz", b"0 0 1\n") for n in range(990)]
        response = made.post(f"{ROOT}/archive", content=b"".join(write(files, "tar.gz", NOW)))
        assert response.json()["outcomes"] == {"refused": 990}


@pytest.mark.parametrize(
    ("method", "path", "more", "expected"),
    [
        ("POST", "archive", {"content": b"x", "headers": {"content-type": "image/png"}}, (415, "unsupported-format")),
        ("POST", "archive", {"files": {"archive": b"x"}}, (415, "unsupported-format")),
        ("PUT", "labels", {"content": LABELS, "headers": {"content-type": "image/png"}}, (415, "unsupported-format")),
        ("PUT", "labels", {"content": b"file\na\n"}, (422, "invalid-parameter")),
        ("PUT", "labels", {"content": b"\xff"}, (422, "invalid-parameter")),
        ("GET", "clouds/nobody.ply", {}, (404, "cloud-not-found")),
        ("GET", "clouds?limit=0", {}, (422, "invalid-parameter")),
        ("GET", "archive?format=rar", {}, (422, "invalid-parameter")),
        ("GET", "clouds?page=3", {}, (422, "invalid-parameter")),
        ("POST", "uploads", {"json": {"length": 0}}, (422, "invalid-parameter")),
        ("POST", "uploads", {"json": {"length": 9, "key": "../a"}}, (422, "invalid-parameter")),
        ("POST", "uploads", {"json": {"length": 2**50}}, (413, "archive-too-large")),
        ("POST", "uploads", {"json": {"length": 2**21, "key": "a.ply"}}, (413, "archive-too-large")),
        ("GET", f"uploads/{'0' * 32}", {}, (404, "upload-not-found")),
        ("DELETE", f"uploads/{'0' * 32}", {}, (404, "upload-not-found")),
        ("POST", f"uploads/{'0' * 32}/finish", {}, (404, "upload-not-found")),
        ("PATCH", f"uploads/{'0' * 32}", {"content": b"x"}, (422, "invalid-parameter")),
    ],
)
def test_what_is_wrong_with_a_request_is_said(
    made: httpx.Client, method: str, path: str, more: dict[str, Any], expected: tuple[int, str]
) -> None:
    assert problem(made.request(method, f"{ROOT}/{path}", **more)) == expected


def test_of_a_dataset_that_is_not_there_nothing_can_be_asked(client: httpx.Client) -> None:
    for method, path, more in (
        ("GET", "", {}),
        ("DELETE", "", {}),
        ("GET", "/clouds", {}),
        ("PUT", "/clouds/a.ply", {"content": ply(1)}),
        ("GET", "/archive", {}),
        ("POST", "/archive", {"content": zipped(("a.ply", ply(1)))}),
        ("GET", "/labels", {}),
        ("PUT", "/labels", {"content": LABELS}),
        ("POST", "/uploads", {"json": {"length": 9}}),
    ):
        assert problem(client.request(method, f"/v1/datasets/nobody{path}", **more)) == (404, "dataset-not-found")


def test_labels_go_up_and_come_down_as_a_table(made: httpx.Client) -> None:
    for seed, key in enumerate(("a.ply", "b.ply")):
        made.put(f"{ROOT}/clouds/{key}", content=ply(seed))
    table = b"file,category,fine,instance,view,group,source\na.ply,mug,big,7,front,g,here\nc.ply,mug,,,,,\n"
    taken = made.put(f"{ROOT}/labels", content=table, headers={"content-type": "text/csv"})
    assert taken.json() == {"labelled": 1, "unknown": 1, "first_unknown": ["c.ply"]}
    got = made.get(f"{ROOT}/labels")
    (row,) = csv.DictReader(io.StringIO(got.text))
    assert (row["file"], row["category"], row["fine"], row["group"], row["source"]) == (
        *("a.ply", "mug", "big", "g", "here"),
    )
    assert got.headers["content-type"].startswith("text/csv")


def test_pages_follow_one_another(made: httpx.Client) -> None:
    for seed in range(5):
        made.put(f"{ROOT}/clouds/{seed}.ply", content=ply(seed))
    found, after = [], ""
    while after is not None:
        page = made.get(f"{ROOT}/clouds", params={"limit": 2, "after": after}).json()
        found += [cloud["key"] for cloud in page["clouds"]]
        after = page["after"]
    assert found == [f"{seed}.ply" for seed in range(5)]


def test_a_dataset_that_a_model_learnt_from_is_kept_unless_forced(
    made: httpx.Client, application: Application, model: ShapeModel
) -> None:
    made.put(f"{ROOT}/clouds/a.ply", content=ply(1))
    learnt = {"kind": "dataset", "name": "mugs", "digest": "0" * 64, "clouds": 1}
    other = {"kind": "folder", "clouds": 3}
    application.store.publish(model, name="m", seed=1, source={"kind": "joined", "clouds": 4, "parts": [other, learnt]})
    refused = made.delete(ROOT)
    assert problem(refused) == (409, "dataset-in-use")
    assert "m:1" in refused.json()["detail"]
    assert keys(made) == ["a.ply"]
    assert made.delete(ROOT, params={"force": True}).status_code == 204
    assert problem(made.get(ROOT)) == (404, "dataset-not-found")
    assert made.put("/v1/datasets/other", json={}).status_code == 200
    assert made.delete("/v1/datasets/other").status_code == 204


class TestPieces:
    @pytest.fixture
    def settings(self, settings: Settings) -> Settings:
        return settings.model_copy(update={"max_body": 2**22, "body_pause": 1.0})

    def begin(self, client: httpx.Client, **more: Any) -> str:
        begun = client.post(f"{ROOT}/uploads", json=more)
        assert (begun.status_code, begun.headers["upload-offset"]) == (201, "0")
        return str(begun.headers["location"])

    def send(self, client: httpx.Client, place: str, offset: int, piece: bytes) -> httpx.Response:
        return client.patch(place, content=piece, headers={"Upload-Offset": str(offset)})

    def test_an_archive_that_is_interrupted_goes_on_where_it_was(self, made: httpx.Client) -> None:
        noise = ("noise.bin", random.Random(1).randbytes(LEAST))
        body = b"".join(write([*[(f"{n}.ply", ply(n)) for n in range(3)], noise], "zip", NOW))
        whole = len(body)
        assert whole > LEAST
        place = self.begin(made, length=whole)
        assert problem(self.send(made, place, 0, body[:100])) == (422, "invalid-parameter")
        assert self.send(made, place, 0, body[:LEAST]).json()["offset"] == LEAST
        assert problem(self.send(made, place, 0, body[:LEAST])) == (409, "upload-conflict")
        assert problem(self.send(made, place, LEAST + 5, body[LEAST + 5 :])) == (409, "upload-conflict")
        assert problem(self.send(made, place, LEAST, body[LEAST:] + b"x")) == (422, "invalid-parameter")
        assert problem(made.post(f"{place}/finish")) == (409, "upload-conflict")
        there = made.get(place)
        assert (there.json()["offset"], there.headers["upload-offset"]) == (LEAST, str(LEAST))
        assert self.send(made, place, LEAST, body[LEAST:]).headers["upload-offset"] == str(whole)
        assert outcomes(made.post(f"{place}/finish"))["2.ply"] == "accepted"
        assert keys(made) == ["0.ply", "1.ply", "2.ply"]
        assert problem(made.get(place)) == (404, "upload-not-found")

    def test_one_cloud_may_come_in_pieces(self, made: httpx.Client) -> None:
        place = self.begin(made, length=len(ply(1)), key="a.ply", viewpoint="0,0,-0.1")
        assert self.send(made, place, 0, ply(1)).status_code == 200
        assert outcomes(made.post(f"{place}/finish")) == {"a.ply": "accepted"}
        (cloud,) = made.get(f"{ROOT}/clouds").json()["clouds"]
        assert cloud["viewpoint"] == [0, 0, -0.1, 1, 0, 0, 0]

    def test_of_two_who_send_the_same_piece_one_is_refused(self, made: httpx.Client) -> None:
        place = self.begin(made, length=4 * LEAST)
        for turn in range(4):
            pieces = [bytes([n]) * LEAST for n in range(4)]
            with ThreadPoolExecutor(4) as threads:
                sent = list(threads.map(lambda piece: self.send(made, place, turn * LEAST, piece), pieces))  # noqa: B023
            assert sorted(each.status_code for each in sent) == [200, 409, 409, 409]
        assert made.get(place).json()["offset"] == 4 * LEAST

    def test_a_piece_that_is_cut_off_leaves_nothing(self, made: httpx.Client, settings: Settings) -> None:
        place = self.begin(made, length=2 * LEAST)

        def halting() -> Any:
            yield bytes(LEAST - 10)
            time.sleep(1.5)
            yield bytes(10)

        with pytest.raises(httpx.HTTPError):
            made.patch(place, content=halting(), headers={"Upload-Offset": "0"}, timeout=5).raise_for_status()
        assert made.get(place).json()["offset"] == 0
        assert not list(Path(settings.store).rglob("pieces/*"))

    def test_an_upload_that_is_given_up_is_gone(self, made: httpx.Client, settings: Settings) -> None:
        place = self.begin(made, length=LEAST * 2)
        self.send(made, place, 0, bytes(LEAST))
        assert problem(made.get(place.replace("mugs", "other"))) == (404, "upload-not-found")
        assert made.delete(place).status_code == 204
        assert problem(self.send(made, place, LEAST, b"x")) == (404, "upload-not-found")
        assert not list(Path(settings.store).rglob("uploads/*/*"))


def test_who_trains_may_alter_and_who_has_answers_may_read(guarded: httpx.Client, settings: Settings) -> None:
    store = KeyStore(settings.store)
    sent = {
        scope: {"Authorization": f"Bearer {store.create(scope, (scope,)).text}"}
        for scope in ("answer", "train", "manage")
    }
    time.sleep(1.1)
    for method, path, more, allowed in (
        ("PUT", ROOT, {"json": {}}, {"train"}),
        ("PUT", f"{ROOT}/clouds/a.ply", {"content": ply(1)}, {"train"}),
        ("GET", f"{ROOT}/clouds/a.ply", {}, {"answer", "train"}),
        ("GET", f"{ROOT}/archive", {}, {"answer", "train"}),
        ("GET", "/v1/datasets", {}, {"answer", "train"}),
        ("POST", f"{ROOT}/uploads", {"json": {"length": 9}}, {"train"}),
        ("DELETE", ROOT, {}, {"train"}),
    ):
        codes = {scope: guarded.request(method, path, headers=key, **more).status_code for scope, key in sent.items()}
        assert {scope for scope, code in codes.items() if code < 300} == allowed, (method, path, codes)
        assert {code for scope, code in codes.items() if scope not in allowed} == {403}


def test_an_archive_whose_client_hangs_up_keeps_what_was_taken_and_can_be_sent_again(
    made: httpx.Client, application: Application
) -> None:
    body = b"".join(write([(f"{n}.ply", ply(n)) for n in range(300)], "tar.gz", NOW))
    head = f"POST {ROOT}/archive HTTP/1.1\r\nHost: x\r\nContent-Length: {len(body)}\r\n\r\n"
    until, go_on = time.monotonic() + 30, threading.Event()
    with socket.create_connection((made.base_url.host, made.base_url.port or 80)) as wire:
        wire.sendall(head.encode() + body)
        while not application.datasets.store.keys("mugs"):
            assert time.monotonic() < until
            time.sleep(0.005)
        for _ in range(application.settings.workers):  # no more is taken until the client is gone
            application.pool._threads.submit(go_on.wait, 30)
    go_on.set()
    while application.pool.at_work or application.datasets.room.held:
        assert time.monotonic() < until
        time.sleep(0.02)
    taken = len(application.datasets.store.keys("mugs"))
    assert 0 < taken < 300
    told = made.post(f"{ROOT}/archive", content=body).json()["outcomes"]
    assert told == {"already-there": taken, "accepted": 300 - taken}


def test_each_cloud_of_an_archive_counts_against_the_rate_of_a_key(guarded: httpx.Client, settings: Settings) -> None:
    key = KeyStore(settings.store).create("hasty", ("train",), rate=2).text
    headers = {"Authorization": f"Bearer {key}"}
    time.sleep(1.1)
    assert guarded.put(ROOT, headers=headers).status_code == 200
    time.sleep(1.1)
    body = zipped(*[(f"{n}.ply", ply(n)) for n in range(6)])
    assert guarded.post(f"{ROOT}/archive", content=body, headers=headers).status_code == 200
    refused = guarded.get(ROOT, headers=headers)
    assert problem(refused) == (429, "rate-exceeded")
    assert int(refused.headers["retry-after"]) > 1


def test_a_key_of_smaller_limits_has_them_here_as_well(guarded: httpx.Client, settings: Settings) -> None:
    key = KeyStore(settings.store).create("small", ("train",), max_body=2000, max_points=149).text
    headers = {"Authorization": f"Bearer {key}"}
    time.sleep(1.1)
    assert guarded.put(ROOT, headers=headers).status_code == 200
    assert problem(guarded.put(f"{ROOT}/clouds/a", content=bytes(2001), headers=headers)) == (413, "content-too-large")
    assert problem(guarded.post(f"{ROOT}/archive", content=bytes(2001), headers=headers)) == (413, "content-too-large")
    begun = guarded.post(f"{ROOT}/uploads", json={"length": 2001}, headers=headers)
    assert problem(begun) == (413, "archive-too-large")
    assert problem(guarded.put(f"{ROOT}/clouds/a", content=ply(1)[:2000], headers=headers))[0] in (400, 413)
    small = zipped(("a.xyz", b"".join(b"0.%03d 0.1 0.5\n" % n for n in range(200))))
    told = guarded.post(f"{ROOT}/archive", content=small, headers=headers).json()["verdicts"]
    assert told[0]["error"]["type"] == "too-many-points"
