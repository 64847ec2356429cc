"""Datasets of a service that is a process: killed in the middle, asked for much, and given real scans."""

from __future__ import annotations

import io
import threading
import time
import zipfile
from pathlib import Path

import httpx
import numpy as np
import pytest

from service.archives import write
from service.datasets import Datasets
from tests.acceptance.test_serve import serving
from tests.service.test_archives import NOW
from tests.service.test_datasets import ply
from worker.sources import Dataset, Folder

ROOT = "/v1/datasets/mugs"
MANY = 400


def test_a_service_killed_amid_an_archive_keeps_whole_clouds_and_takes_the_others_the_next_time(tmp_path: Path) -> None:
    store = str(tmp_path / "store")
    body = b"".join(write([(f"{n}.ply", ply(n)) for n in range(MANY)], "tar.gz", NOW))
    datasets = Datasets(store)
    with serving(store) as (process, client):
        assert client.put(ROOT, json={}).status_code == 200

        def send() -> None:
            with pytest.raises(httpx.TransportError):
                client.post(f"{ROOT}/archive", content=body)

        sender = threading.Thread(target=send)
        sender.start()
        while len(datasets.keys("mugs")) < 20:
            time.sleep(0.005)
        process.kill()
        sender.join()
    taken = datasets.entries("mugs")
    assert 20 <= len(taken) < MANY
    for entry in taken:
        assert datasets.content(entry) == ply(int(entry.key.partition(".")[0]))
    with serving(store) as (_, client):
        told = client.post(f"{ROOT}/archive", content=body).json()["outcomes"]
        assert told == {"already-there": len(taken), "accepted": MANY - len(taken)}
        assert client.get(ROOT).json()["clouds"] == MANY


def test_an_upload_in_pieces_goes_on_with_another_process(tmp_path: Path) -> None:
    store, size = str(tmp_path / "store"), 2**18
    noise = ("noise.bin", np.random.default_rng(1).bytes(2 * size))
    body = b"".join(write([("a.ply", ply(1)), noise], "zip", NOW))
    with serving(store) as (process, client):
        client.put(ROOT, json={})
        place = client.post(f"{ROOT}/uploads", json={"length": len(body)}).headers["location"]
        assert client.patch(place, content=body[:size], headers={"Upload-Offset": "0"}).status_code == 200
        process.kill()
    with serving(store) as (_, client):
        offset = client.get(place).json()["offset"]
        assert offset == size
        assert client.patch(place, content=body[size:], headers={"Upload-Offset": str(offset)}).status_code == 200
        assert client.post(f"{place}/finish").json()["outcomes"] == {"accepted": 1, "left-out": 1}


@pytest.mark.slow
def test_the_memory_does_not_grow_with_an_archive(tmp_path: Path) -> None:
    def peak(pid: int) -> int:
        """Largest resident memory so far, bytes."""
        status = Path(f"/proc/{pid}/status").read_text()
        return 1024 * int(next(line.split()[1] for line in status.splitlines() if line.startswith("VmHWM")))

    def archive(count: int) -> bytes:
        clouds = []
        for n in range(count):
            file = io.BytesIO()
            corners = ((-0.05, -0.05, 0.45), (0.05, 0.05, 0.55))
            np.save(file, np.random.default_rng(n).uniform(*corners, (50_000, 3)))
            clouds.append((f"{n}.npy", file.getvalue()))
        return b"".join(write(clouds, "tar.gz", NOW))

    with serving(str(tmp_path / "store")) as (process, client):
        client.put(ROOT, json={})
        assert client.post(f"{ROOT}/archive", content=archive(4)).json()["outcomes"] == {"accepted": 4}
        assert client.get(f"{ROOT}/archive").status_code == 200
        before, body = peak(process.pid), archive(100)
        assert len(body) > 10**8
        told = client.post(f"{ROOT}/archive", content=body).json()["outcomes"]
        assert told == {"already-there": 4, "accepted": 96}
        with client.stream("GET", f"{ROOT}/archive") as packed:
            assert sum(map(len, packed.iter_bytes())) > 10**8
        assert peak(process.pid) - before < len(body) / 2


@pytest.mark.data
def test_real_scans_with_their_labels_are_a_dataset_to_learn_from(scans: Path, tmp_path: Path) -> None:
    folder = scans / "scans"
    body = io.BytesIO()
    with zipfile.ZipFile(body, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(path for path in folder.rglob("*") if path.is_file()):
            archive.write(file, file.relative_to(folder).as_posix())
    with serving(str(tmp_path / "store")) as (_, client):
        client.put(ROOT, json={})
        told = client.post(f"{ROOT}/archive", content=body.getvalue())
        assert told.json()["outcomes"].get("refused", 0) == 0
        held = client.get(ROOT).json()
        assert sum(held["categories"].values()) == held["clouds"] == Folder(folder).count
        rows = {line.split(",")[0] for line in client.get(f"{ROOT}/labels").text.splitlines()[1:]}
        assert rows == {line.split(",")[0] for line in (folder / "labels.csv").read_text().splitlines()[1:]}
    source = Dataset(Datasets(tmp_path / "store"), "mugs")
    for (key, cloud), (name, expected) in zip(source, Folder(folder), strict=True):
        assert key == f"mugs/{name}"
        assert np.array_equal(cloud.points, expected.points)
