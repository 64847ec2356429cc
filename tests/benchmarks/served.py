"""What a model holds when it is served: `python -m tests.benchmarks.served STORE NAME CLOUD`, a process of its own."""

from __future__ import annotations

import sys

import numpy as np
import psutil

from service.engine.cloud import PointCloud
from service.store import ModelStore

ANSWERS = 5


def main(url: str, name: str, cloud: str) -> None:
    """Loads the model, answers, and prints by how much that made the process larger."""
    process = psutil.Process()
    before = process.memory_info().rss
    store = ModelStore(url)
    model, _ = store.load(*store.resolve(name))
    points = PointCloud(np.load(cloud))
    for _ in range(ANSWERS):
        model.respond(points)
    whole = process.memory_info().rss
    print(
        f"served: {whole / 2**20:.0f} MiB, {(whole - before) / 2**20:.0f} MiB of them the model and what it keeps ready"
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
