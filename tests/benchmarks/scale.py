"""What a model of many objects costs, stage by stage, from simulation to the first answers: `./run bench scale`.

Processor seconds of this process and the most memory it held in each stage. Objects are simulated and described in
shards, which are kept in a folder where one is named: a run that was broken off goes on there.
"""

from __future__ import annotations

import argparse
import pickle
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import psutil
from joblib import Parallel, delayed

from service.engine.model import ShapeModel
from service.engine.params import ModelParams
from service.store import ModelStore
from worker.learning.observations import NamedCloud, Observation, observe
from worker.learning.train import learn
from worker.sharing import shared_out
from worker.simulation import SimulationParams, simulate_object

SHARD = 250  # objects
ASKED = 30  # new objects that are answered
TRIES = 3  # of which the fastest counts
LOOK_EVERY = 0.05  # seconds between two looks at the memory
MEBIBYTE = 2**20


class Meter:
    """Prints what each stage took when the next begins."""

    def __init__(self) -> None:
        self._process, self._peak = psutil.Process(), 0
        self._stage = ""
        threading.Thread(target=self._watch, daemon=True).start()

    def begin(self, stage: str) -> None:
        """A stage begins, and the one before is over."""
        if self._stage:
            spent, elapsed = time.process_time() - self._spent, time.monotonic() - self._began
            print(f"{self._stage:26}{spent:10.2f} s{elapsed:10.1f} s{self._peak / MEBIBYTE:10.0f} MiB", flush=True)
        self._stage, self._spent, self._began, self._peak = stage, time.process_time(), time.monotonic(), 0

    def _watch(self) -> None:
        while True:
            self._peak = max(self._peak, self._process.memory_info().rss)
            time.sleep(LOOK_EVERY)


def main(arguments: list[str]) -> None:
    """Simulates, learns, publishes, loads and answers."""
    parser = argparse.ArgumentParser(prog="./run bench scale", description=__doc__)
    parser.add_argument("--objects", type=int, default=1000, help="simulated objects (1000)")
    parser.add_argument("--seed", type=int, default=7, help="of the simulation (7)")
    parser.add_argument("--renderer", choices=["sapien", "raycast"], default="sapien")
    parser.add_argument("--workers", type=int, default=1, help="processes (1)")
    parser.add_argument("--cluster", help="Dask scheduler that does the work instead")
    parser.add_argument("--kept", type=Path, help="folder of shards, to go on with")
    asked = parser.parse_args(arguments)
    params, meter = SimulationParams(renderer=asked.renderer), Meter()
    print(f"{asked.objects} objects{'':8}processor{'':8}wall{'':8}memory", flush=True)
    with tempfile.TemporaryDirectory() as folder, shared_out(asked.workers, asked.cluster):
        objects = _objects(asked.objects, asked.seed, params, asked.kept or Path(folder), meter.begin)
        model = learn(objects, ModelParams(), asked.seed, meter.begin)
        meter.begin("publishing")
        store = ModelStore(folder)
        source = {"kind": "simulation", "clouds": len(objects)}
        manifest = store.publish(model, name="scale", seed=asked.seed, source=source, alias="production")
        del model, objects
        meter.begin("loading")
        loaded, _ = store.load(*store.resolve("scale"))
        meter.begin("answering")
        median = _answer(loaded, asked.seed + 1, params)
        meter.begin("end")
        cloud = Path(folder) / "cloud.npy"
        np.save(cloud, simulate_object(0, asked.seed + 1, params).cloud.points)
        subprocess.run([sys.executable, "-m", "tests.benchmarks.served", folder, "scale", str(cloud)], check=True)
    print(", ".join(f"{name} {count}" for name, count in manifest.counts.items()))
    print(f"an answer: {median * 1e3:.1f} ms of one core, the median of {ASKED} new objects")


def _objects(
    count: int, seed: int, params: SimulationParams, kept: Path, on_stage: Callable[[str], None]
) -> list[Observation]:
    """Simulates and describes what the folder lacks, shard by shard."""
    on_stage("simulate and describe")
    kept.mkdir(parents=True, exist_ok=True)
    objects: list[Observation] = []
    for first in range(0, count, SHARD):
        file = kept / f"{first:06}.pkl"
        if not file.exists():
            shard = _observed(range(first, min(first + SHARD, count)), seed, params)
            file.with_suffix(".unfinished").write_bytes(pickle.dumps(shard, protocol=5))
            file.with_suffix(".unfinished").rename(file)
        objects += pickle.loads(file.read_bytes())
    return objects[:count]


def _observed(indices: Iterable[int], seed: int, params: SimulationParams) -> list[Observation]:
    simulated = Parallel()(delayed(simulate_object)(index, seed, params) for index in indices)
    clouds = (NamedCloud(f"simulated/{seed}/{each.index}", each.cloud) for each in simulated)
    return [each for each in observe(clouds, ModelParams()) if isinstance(each, Observation)]


def _answer(model: ShapeModel, seed: int, params: SimulationParams) -> float:
    """The median time of an answer, seconds of the processor, of objects that the model never saw."""
    times = []
    for index in range(ASKED):
        cloud, tries = simulate_object(index, seed, params).cloud, []
        for _ in range(TRIES):
            began = time.process_time()
            model.respond(cloud)
            tries.append(time.process_time() - began)
        times.append(min(tries))
    return float(np.median(times))
