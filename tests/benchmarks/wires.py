"""What each wire costs above the engine's own time; what both cores answer; and what happens under four times of that.

The engine's time is that of `model.respond` of the decoded cloud in this process, on one thread; requests take turns
with it, so that both see the same machine. Clients take part in the processors: their share is told, and the
processor time that the service spends on an answer as well.
"""

from __future__ import annotations

import argparse
import io
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from statistics import median
from typing import NamedTuple

import numpy as np

from service import clouds
from service.engine.cloud import PointCloud
from service.engine.model import ShapeModel
from tests.benchmarks.askers import WIRES, Asker, Place
from tests.benchmarks.clouds import benchmark_clouds
from tests.benchmarks.engines import at_once, built_in_model
from tests.benchmarks.load import Told, files_in, put_under_load, quantile
from tests.benchmarks.replicas import Replica, replica

POINTS, SEED = 10_000, 1
TURNS, EACH = 12, 15  # turns of each wire, and requests of one turn
AGAIN = 3  # requests that begin a turn and are not counted: caches were another's before
LOADED = ("REST npy", "gRPC points", "zenoh npy")
WAITING = 2  # clients a worker: one is answered, another waits already
CROWD = 48  # clients under overload
OVERLOAD = 4.0


class Cost(NamedTuple):
    """Requests one after another: seconds that each took, and processor time of the service on each, seconds."""

    taken: list[float]
    worked: float


def main(arguments: list[str]) -> None:
    """Prints three tables."""
    parser = argparse.ArgumentParser(prog="./run bench wires", description=__doc__)
    parser.add_argument("--seconds", type=float, default=8.0, help="of each load")
    parser.add_argument("--only", choices=("rest", "throughput", "overload"), action="append")
    given = parser.parse_args(arguments)
    parts = given.only or ["rest", "throughput", "overload"]
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        data, cloud = write_cloud(folder)
        model = built_in_model()
        print(f"cloud: {POINTS} points of {data}")
        engine = at_rest(folder, model, cloud, show="rest" in parts)
        if "throughput" in parts or "overload" in parts:
            under_load(folder, engine, given.seconds, "overload" in parts)


def write_cloud(folder: Path) -> tuple[str, PointCloud]:
    """Writes a cloud of so many points in every form; returns what it is, and the cloud."""
    data, found = benchmark_clouds()
    random = np.random.default_rng(SEED)
    largest = max(found, key=lambda cloud: len(cloud.points)).points
    among = sorted((c.points for c in found if len(c.points) >= POINTS), key=len)
    chosen = among[0] if among else largest
    xyz = chosen[np.sort(random.choice(len(chosen), POINTS, replace=len(chosen) < POINTS))].astype("<f4")
    npy = io.BytesIO()
    np.save(npy, xyz)
    head = (
        "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
        f"WIDTH {POINTS}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {POINTS}\nDATA binary\n"
    )
    cloud = clouds.read(npy.getvalue())
    files = {
        "npy": npy.getvalue(),
        "ply": clouds.write_ply(cloud),
        "pcd": head.encode() + xyz.tobytes(),
        "json": str([[round(float(value), 5) for value in point] for point in xyz]).encode(),
    }
    for form, content in files.items():
        (folder / f"cloud.{form}").write_bytes(content)
    return data, cloud


def at_rest(folder: Path, model: ShapeModel, cloud: PointCloud, *, show: bool) -> float:
    """Requests one after another, in turns with the engine; returns the engine's median, seconds."""
    engine: list[float] = []
    with replica(folder, "alone") as one:
        askers = {wire: make(place_of(one), files_in(folder)) for wire, make in WIRES.items()} if show else {}
        for asker in askers.values():
            ask_some(one, asker)
        ask_engine(model, cloud)
        costs: dict[str, list[Cost]] = {wire: [] for wire in askers}
        for _ in range(TURNS):
            engine += ask_engine(model, cloud)
            for wire, asker in askers.items():
                costs[wire].append(ask_some(one, asker))
    alone = median(engine)
    print(f"engine: p50 {1e3 * alone:.2f} ms, p99 {quantile(engine, 0.99):.2f} ms")
    if show:
        print(f"{'one request at a time':24} {'p50':>9} {'above engine':>13} {'p99':>9} {'server cpu':>11}")
    for wire, seen in costs.items():
        taken = [seconds for cost in seen for seconds in cost.taken]
        worked = sum(cost.worked for cost in seen) / len(taken)
        print(
            f"{wire:24} {quantile(taken, 0.5):6.2f} ms {quantile(taken, 0.5) - 1e3 * alone:10.2f} ms "
            f"{quantile(taken, 0.99):6.2f} ms {1e3 * worked:8.2f} ms"
        )
    return alone


def ask_engine(model: ShapeModel, cloud: PointCloud) -> list[float]:
    """Seconds that some answers of the engine take."""
    taken = []
    for _ in range(AGAIN):
        model.respond(cloud)
    for _ in range(EACH):
        began = time.perf_counter()
        model.respond(cloud)
        taken.append(time.perf_counter() - began)
    return taken


def ask_some(one: Replica, asker: Asker) -> Cost:
    """What some requests cost."""
    for _ in range(AGAIN):
        asker.ask()
    before, taken = one.worked(), []
    for _ in range(EACH):
        began = time.perf_counter()
        if not asker.ask():
            raise RuntimeError("refused, though nobody else asks")
        taken.append(time.perf_counter() - began)
    return Cost(taken, one.worked() - before)


def under_load(folder: Path, engine: float, seconds: float, overload: bool) -> None:
    """What both cores answer, in two arrangements, and then at four times that rate."""
    for name, replicas, workers in (("two replicas, a worker each", 2, 1), ("one replica, two workers", 1, 2)):
        with ExitStack() as stack:
            given = {"WORKERS": str(workers)}
            running = [stack.enter_context(replica(folder, f"{name}-{n}", **given)) for n in range(replicas)]
            print(f"{name}:")
            for wire in LOADED:
                peer = at_once(folder, 2, seconds / 2)
                told, spent = loaded(wire, running, folder, seconds)
                rate = len(told.answered) / told.seconds
                print(
                    f"  {wire:12} {rate:6.1f} answers/s: {rate * engine / 2:4.0%} of twice the engine alone, "
                    f"{rate / peer:4.0%} of two engines at once; p50 {quantile(told.answered, 0.5):.2f}, p99 "
                    f"{quantile(told.answered, 0.99):.2f} ms; processor an answer: service {1e3 * spent:.2f}, clients "
                    f"{1e3 * told.worked / len(told.answered):.2f} ms"
                )
                if overload:
                    told, _ = loaded(wire, running, folder, seconds, OVERLOAD * rate)
                    tell_overload(told, rate, engine)


def loaded(wire: str, running: list[Replica], folder: Path, seconds: float, rate: float = 0.0) -> tuple[Told, float]:
    """What a load sees, and processor time of the service on an answer, seconds."""
    before, answers = sum(one.worked() for one in running), sum(one.answered() for one in running)
    places = [place_of(one) for one in running]
    told = put_under_load(wire, places, folder, CROWD if rate else 2 * WAITING, seconds, rate)
    answers = sum(one.answered() for one in running) - answers
    return told, (sum(one.worked() for one in running) - before) / answers


def tell_overload(told: Told, rate: float, engine: float) -> None:
    """A line of what became of too many requests."""
    asked, answered = len(told.answered) + len(told.refused), len(told.answered)
    middle, worst = quantile(told.answered, 0.5), quantile(told.answered, 0.99)
    had = answered / told.seconds
    print(
        f"    at {asked / told.seconds:.0f} requests/s: {had:.1f} answers/s "
        f"({had / rate:.0%}); p50 {middle:.2f}, p99 {worst:.2f} ms, {worst / middle:.1f} times that, "
        f"{worst / (1e3 * engine):.1f} times the engine's; refusals p50 {quantile(told.refused, 0.5):.2f}, p99 "
        f"{quantile(told.refused, 0.99):.2f} ms; {told.late:.0%} begun late; clients {told.worked / told.seconds:.2f} "
        "processors"
    )


def place_of(one: Replica) -> Place:
    """Where a replica can be asked."""
    return Place(one.http.removeprefix("http://"), one.grpc, one.zenoh)
