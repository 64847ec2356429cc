"""Replicas as processes of a benchmark's own, over a store without models: the built-in one answers."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import httpx

from tests.service.transports.zenoh.router import free_endpoint

PATIENCE = 60.0  # seconds for a replica to get ready
COUNT = "shape_concepts_novelty_count"
TICKS = os.sysconf("SC_CLK_TCK")


class Replica(NamedTuple):
    """A replica and where it can be asked: a URL, HOST:PORT, zenoh's endpoint; seconds until it said it was ready."""

    process: subprocess.Popen[bytes]
    http: str
    grpc: str
    zenoh: str
    ready: float

    def memory(self) -> float:
        """Resident memory, MiB."""
        pages = int(Path(f"/proc/{self.process.pid}/statm").read_text().split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE") / 2**20

    def answered(self) -> float:
        """How many clouds it answered."""
        page = httpx.get(f"{self.http}/metrics", timeout=10).text
        return float(next(line.split()[1] for line in page.splitlines() if line.startswith(COUNT)))

    def worked(self) -> float:
        """Processor time that it used, seconds."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / TICKS


@contextmanager
def replica(folder: Path, name: str, **settings: str) -> Iterator[Replica]:
    """A replica with settings of its own, once it is ready."""
    http, rpc = (free_endpoint().removeprefix("tcp/") for _ in range(2))
    zenoh = free_endpoint()
    command = [sys.executable, "-m", "service.cli", "serve", "--port", http.rpartition(":")[2]]
    given = {
        "STORE": str(folder / "store"),
        "JOBS_URL": f"sqlite:///{folder / 'jobs.sqlite'}",
        "GRPC_PORT": rpc.rpartition(":")[2],
        "ZENOH_LISTEN": zenoh,
        "WORKERS": "1",
    }
    environment = os.environ | {f"SHAPE_CONCEPTS_{key}": value for key, value in (given | settings).items()}
    began = time.monotonic()
    with (folder / f"{name}.log").open("wb") as log:
        process = subprocess.Popen(command, stderr=log, env=environment)
    try:
        while not _ready(f"http://{http}/readyz"):
            if process.poll() is not None or time.monotonic() - began > PATIENCE:
                raise RuntimeError(f"replica {name} is not ready:\n{(folder / f'{name}.log').read_text()[-3000:]}")
            time.sleep(0.02)
        yield Replica(process, f"http://{http}", rpc, zenoh, time.monotonic() - began)
    finally:
        process.terminate()
        process.wait(60)
        said = (folder / f"{name}.log").read_text()
        if faults := [line for line in said.splitlines() if " WARNING " in line or " ERROR " in line]:
            print(f"replica {name} logged:\n" + "\n".join(faults[-20:]))


def _ready(url: str) -> bool:
    try:
        return httpx.get(url, timeout=10).status_code == 200
    except httpx.TransportError:
        return False
