"""Engines without a service around them, one a processor: what the service's answers are compared with."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

from service import clouds
from service.built_in import built_in
from service.engine.model import ShapeModel
from tests.conftest import ROOT


def built_in_model() -> ShapeModel:
    """The model that the replicas answer with."""
    store = built_in()
    return store.load(*store.resolve(store.names()[0]))[0]


def at_once(folder: Path, engines: int, seconds: float) -> float:
    """Answers a second of several engines that run at the same time, each in a process and a thread of its own.

    Args:
        folder: with the cloud as cloud.npy.
        engines: how many.
        seconds: for how long.
    """
    command = [sys.executable, "-m", "tests.benchmarks.engines", str(folder / "cloud.npy"), str(seconds)]
    pipe = subprocess.PIPE
    running = [subprocess.Popen(command, cwd=ROOT, stdin=pipe, stdout=pipe, text=True) for _ in range(engines)]
    for one in running:
        assert one.stdout is not None
        one.stdout.readline()  # it has answered once
    for one in running:
        assert one.stdin is not None
        one.stdin.write("\n")
        one.stdin.flush()
    return sum(float(one.communicate(timeout=60 + seconds)[0]) for one in running)


def main(file: str, seconds: float) -> None:
    """One of them; prints its answers a second."""
    model, cloud = built_in_model(), clouds.read(Path(file).read_bytes())
    for _ in range(5):
        model.respond(cloud)
    print("ready", flush=True)
    sys.stdin.readline()
    began, answered = time.perf_counter(), 0
    while time.perf_counter() - began < seconds:
        model.respond(cloud)
        answered += 1
    print(answered / (time.perf_counter() - began))


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]))
