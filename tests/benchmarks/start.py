"""How long commands take to start, with kernels compiled before: wall and processor time, the best of several."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import httpx

from service.clouds import write_ply
from tests.benchmarks.clouds import benchmark_clouds
from tests.benchmarks.replicas import replica
from tests.conftest import ROOT

REPEATS = 5
HELPS = (
    ("service.cli", "--help"),
    ("service.cli", "respond", "--help"),
    ("service.cli", "jobs", "submit", "--help"),
    ("worker.cli", "--help"),
    ("worker.cli", "train", "--help"),
)
STEPS = """
import json, sys, time
began = time.perf_counter()
from service.application import Application, CloudFile
from service.settings import Settings
imported = time.perf_counter()
application = Application(Settings())
application.prepare(None)
loaded = time.perf_counter()
data = open(sys.argv[1], "rb").read()
application.respond(CloudFile(data))
first = time.perf_counter()
application.respond(CloudFile(data))
print(json.dumps([imported - began, loaded - imported, first - loaded, time.perf_counter() - first]))
"""


class Took(NamedTuple):
    """Seconds by the clock, and of the processor."""

    wall: float
    processor: float


def main(_: list[str]) -> None:
    """Prints a table."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        _, clouds = benchmark_clouds()
        cloud = folder / "cloud.ply"
        cloud.write_bytes(write_ply(clouds[0]))
        given = {"STORE": str(folder / "store"), "JOBS_URL": f"sqlite:///{folder / 'jobs.sqlite'}"}
        environment = os.environ | {f"SHAPE_CONCEPTS_{name}": value for name, value in given.items()}
        print(f"best of {REPEATS}; load of the machine before: {os.getloadavg()[0]:.1f}")
        for words in HELPS:
            tell(f"{words[0]} {' '.join(words[1:])}", best(["-m", *words], environment), 0.3)
        respond = ["-m", "service.cli", "respond", "--json", str(cloud)]
        run(respond, environment)  # compiles
        tell("respond CLOUD, built-in model", best(respond, environment), 2.0)
        steps = [step_seconds(cloud, environment) for _ in range(REPEATS)]
        names = ("imports", "model", "first answer", "second answer")
        for name, column in zip(names, zip(*steps, strict=True), strict=True):
            print(f"  of that {name:<34} {min(column):6.3f} s")
        tell_replicas(folder, cloud)


def tell_replicas(folder: Path, cloud: Path) -> None:
    """Prints how long a replica takes until it says that it is ready, and for its first answer then."""
    ready, first = [], []
    for number in range(REPEATS):
        with replica(folder, f"replica-{number}") as one:
            ready.append(Took(one.ready, one.worked()))
            began = time.perf_counter()
            httpx.post(f"{one.http}/v1/responses", content=cloud.read_bytes(), timeout=60).raise_for_status()
            first.append(time.perf_counter() - began)
    tell("a replica until GET /readyz is 200", Took(*map(min, zip(*ready, strict=True))), 5.0)
    print(f"  its first answer right after that {min(first):14.3f} s")


def tell(what: str, took: Took, wanted: float) -> None:
    """Prints a row."""
    print(f"{what:<42} {took.wall:6.3f} s, processor {took.processor:6.3f} s (wanted: {wanted} s)")


def best(words: list[str], environment: dict[str, str]) -> Took:
    """The least that a command takes."""
    return Took(*map(min, zip(*(run(words, environment) for _ in range(REPEATS)), strict=True)))


def run(words: list[str], environment: dict[str, str]) -> Took:
    """What a command takes."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    quiet = subprocess.DEVNULL
    subprocess.run([sys.executable, *words], check=True, cwd=ROOT, env=environment, stdout=quiet, stderr=quiet)
    wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    return Took(wall, after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime)


def step_seconds(cloud: Path, environment: dict[str, str]) -> list[float]:
    """Seconds of each step of a first answer, in a process of its own."""
    command = [sys.executable, "-c", STEPS, str(cloud)]
    done = subprocess.run(command, check=True, cwd=ROOT, env=environment, stdout=subprocess.PIPE)
    return [float(part) for part in done.stdout.decode().strip("[] \n").split(",")]
