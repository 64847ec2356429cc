"""How long learning takes, against PCL and scipy in the same run: `./run bench learning`.

Three parts, each of which can be asked for alone:

train    `shape-concepts-worker train --simulate 250` from start to published model, against the time that PCL's
         supervoxels, normals, merge and FPFH of the same clouds take on one thread, loading not counted (`--peer`).
profile  what an object costs, step by step, and where the time of the training goes.
tree     the spanning tree of real stimuli, against scipy's `minimum_spanning_tree` of all distances, and how it grows.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from joblib import parallel_config
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial.distance import pdist, squareform

from service.engine.cloud import PointCloud
from service.engine.params import ModelParams
from tests.benchmarks.scale import _objects
from worker.learning.dictionary import learn_dictionary
from worker.learning.hierarchy import grow_ensemble, sample
from worker.learning.observations import NamedCloud, Observation, observe_one
from worker.learning.single import one_thread
from worker.learning.space import build_space
from worker.learning.stimuli import stimulate_all
from worker.simulation import SimulationParams, _render, simulate_object
from worker.simulation.camera import draw_view
from worker.simulation.compositions import compose
from worker.simulation.sensor import measure

SEED = 7
REPEATS = 3
CORES = 2
TREE = 2000  # objects of which all distances are computed
SHARE = 400  # of which scipy's own divergence is, which takes minutes for all
NOISE = 0.1  # of the logarithm of a bin: a whole is 0.0013 nats from itself, as from itself measured again
TINY = 1e-300  # 0 ln 0 is 0
LOOK_EVERY = 0.02  # seconds between two looks at processes
QUARTER = 0.25  # of the peer's time, to be reached
PARTS = ("train", "profile", "tree")


def main(arguments: list[str]) -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(prog="./run bench learning", description=__doc__)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS), help="which of them (all)")
    parser.add_argument("--objects", type=int, default=250, help="that are simulated and learnt (250)")
    parser.add_argument("--renderers", nargs="+", default=["raycast", "sapien"], help="raycast, sapien (both)")
    parser.add_argument("--peer", type=Path, help="the program pclpeer, to be measured against")
    parser.add_argument("--sizes", type=int, nargs="+", default=[TREE], help=f"of trees ({TREE})")
    parser.add_argument("--kept", type=Path, help="folder of described objects, to go on with")
    parser.add_argument("--simulated", type=int, help="at most so many objects of trees; others are these, perturbed")
    asked = parser.parse_args(arguments)
    for renderer in asked.renderers:
        if "train" in asked.parts:
            _train(asked.objects, renderer, asked.peer)
        if "profile" in asked.parts:
            _profile(renderer)
    if "tree" in asked.parts:
        with tempfile.TemporaryDirectory() as folder, parallel_config(backend="loky", n_jobs=CORES):
            _trees(sorted(asked.sizes), asked.simulated or max(asked.sizes), asked.kept or Path(folder))


def _train(count: int, renderer: str, peer: Path | None) -> None:
    """The whole command, several times in turn with the peer; of each the fastest counts."""
    params = SimulationParams(renderer=renderer)
    with tempfile.TemporaryDirectory() as folder:
        clouds = [simulate_object(index, SEED, params).cloud for index in range(count)] if peer else []
        files = [_write_pcd(Path(folder, f"{number:05}.pcd"), cloud) for number, cloud in enumerate(clouds)]
        command = [sys.executable, "-m", "worker.cli", "train", "--simulate", str(count), "--seed", str(SEED)]
        command += ["--name", "bench", "--renderer", renderer, "--workers", str(CORES), "--store", f"{folder}/store"]
        runs, peers = [], []
        for _ in range(REPEATS):
            runs.append(_watched(command))
            if peer:
                peers.append(sum(_pcl_seconds(peer, file) for file in files))
    wall, _, stages = min(runs, key=lambda run: run[0])
    processor = min(run[1] for run in runs)
    print(f"{count} objects, {renderer}, {CORES} cores, best of {REPEATS}: simulated, learned and published")
    for stage, seconds in stages.items():
        print(f"  {stage:<28} {seconds:8.2f} s")
    print(f"  all                          {wall:8.2f} s")
    print(f"  processor time               {processor:8.2f} s")
    if peers:
        theirs = min(peers)
        print(f"  PCL, one thread              {theirs:8.2f} s   supervoxels, normals, merge, FPFH of the same clouds")
        print(f"  all / PCL                    {wall / theirs:8.3f}   at most {QUARTER}")
        print(
            f"  processor time / cores / PCL {processor / CORES / theirs:8.3f}   were both cores free, and always busy"
        )


def _watched(command: list[str]) -> tuple[float, float, dict[str, float]]:
    """Wall and processor time of a command and all its processes, seconds, and the wall time of each stage it tells."""
    began = time.monotonic()
    process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
    assert process.stderr is not None
    root, spent, marks = psutil.Process(process.pid), dict[int, float](), [("start", 0.0)]
    family: list[psutil.Process] = [root]

    def follow() -> None:
        for line in process.stderr or ():
            if line.rstrip().endswith("..."):
                marks.append((line.rstrip()[:-4], time.monotonic() - began))

    reader = threading.Thread(target=follow)
    reader.start()
    while process.poll() is None:
        try:
            family = [root, *root.children(recursive=True)]
        except psutil.NoSuchProcess:
            break
        for each in family:
            try:
                times = each.cpu_times()
                spent[each.pid] = times.user + times.system
            except psutil.NoSuchProcess:
                continue
        time.sleep(LOOK_EVERY)
    wall = time.monotonic() - began
    reader.join()
    if process.wait() != 0:
        raise SystemExit(f"{' '.join(command)} failed")
    ends = [when for _, when in marks[1:]] + [wall]
    return wall, sum(spent.values()), {name: end - when for (name, when), end in zip(marks, ends, strict=True)}


def _pcl_seconds(peer: Path, file: Path) -> float:
    options = ["0.006", "0.02", "--mode", "smooth", "--angle", "15", "--min", "5", "--threads", "1"]
    said = subprocess.run([str(peer), str(file), *options], capture_output=True, text=True, check=True).stdout
    took: dict[str, float] = json.loads(said)["ms"]
    return sum(ms for step, ms in took.items() if step != "load") / 1e3


def _write_pcd(file: Path, cloud: PointCloud) -> Path:
    header = (
        f"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {len(cloud.points)}\nHEIGHT 1\n"
        f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(cloud.points)}\nDATA binary\n"
    )
    file.write_bytes(header.encode() + np.ascontiguousarray(cloud.points, "<f4").tobytes())
    return file


def _profile(renderer: str, count: int = 50) -> None:
    """What each step of an object costs, processor time."""
    params, spent = SimulationParams(renderer=renderer), dict[str, float]()

    def timed(step: str, work: Callable[..., Any], *arguments: Any) -> Any:
        began = time.process_time()
        result = work(*arguments)
        spent[step] = spent.get(step, 0.0) + time.process_time() - began
        return result

    for index in range(-1, count):
        if index == 0:
            spent.clear()  # the one before loaded what was compiled
        rng = np.random.default_rng(np.random.SeedSequence(SEED, spawn_key=(index + 1,)))
        composition = timed("compose", compose, params.orders[index % 5], params.prototypes, rng)
        view = timed("draw the view", draw_view, composition, params.camera, rng)
        image = timed("render", _render, composition, view, params)
        cloud = timed("measure", measure, image, composition, view, params, rng).cloud
        if len(cloud.points) >= params.min_points:
            timed("describe", observe_one, NamedCloud("bench", cloud), ModelParams())
    print(f"an object, {renderer}, processor time, mean of {count}")
    for step, seconds in spent.items():
        print(f"  {step:<28} {1e3 * seconds / count:8.2f} ms")


def _trees(sizes: list[int], simulated: int, kept: Path) -> None:
    """The tree of each size, and for the smallest scipy's."""
    objects = _objects(min(sizes[-1], simulated), SEED, SimulationParams(renderer="raycast"), kept, lambda _: None)
    print(f"{len(objects)} objects simulated, {max(sizes[-1] - len(objects), 0)} perturbed")
    objects += _perturbed(objects, sizes[-1] - len(objects))
    params, times = ModelParams(), dict[int, float]()
    for size in sizes:
        own = objects[:size]
        with one_thread():
            dictionary = learn_dictionary(np.concatenate([o.segment_descriptors for o in own]), params.dictionary)
            ensemble = grow_ensemble(own, dictionary, sample(own, params.hierarchy.max_objects))
            stimuli = stimulate_all(own, dictionary, ensemble, params.stimuli)
            build_space(stimuli[:100])  # loads what was compiled
            before = psutil.Process().memory_info().rss
            walls, processor = [], []
            for _ in range(REPEATS if size <= 10_000 else 1):
                began, spent = time.perf_counter(), time.process_time()
                space = build_space(stimuli)
                walls.append(time.perf_counter() - began)
                processor.append(time.process_time() - spent)
        times[size] = min(processor)
        held = (psutil.Process().memory_info().rss - before) / 2**20
        print(f"tree of {size} stimuli ({stimuli.nnz / size:.0f} of {stimuli.shape[1]} dimensions filled)")
        print(f"  wall, {CORES} threads              {min(walls):8.2f} s")
        print(f"  processor time               {times[size]:8.2f} s   {held:+.0f} MiB held after")
        if size <= TREE:
            _scipy(stimuli, space.edges, min(walls), times[size])
    for small, large in pairwise(sizes):
        power = np.log(times[large] / times[small]) / np.log(large / small)
        print(f"from {small} to {large}: {times[large] / times[small]:.1f} times the processor time, power {power:.2f}")


def _perturbed(objects: list[Observation], count: int) -> list[Observation]:
    """The objects once more, with descriptions as much changed as by the sensor's noise, drawn anew, bin by bin.

    Their hashes are such that none of them is memorised.
    """
    rng, out = np.random.default_rng(SEED), []
    for number in range(count):
        seen = objects[number % len(objects)]
        descriptors = seen.descriptors * np.exp(NOISE * rng.standard_normal(seen.descriptors.shape))
        descriptors /= descriptors.sum(axis=1, keepdims=True)
        name = f"perturbed/{number}"
        out.append(replace(seen, key=name, digest=f"~{name}", descriptors=descriptors.astype(np.float32)))
    return out


def _scipy(stimuli: csr_array, edges: NDArray[np.int64], wall: float, processor: float) -> None:
    """Dense: all distances of rows without the dimensions that nothing fills, then scipy's tree, on one thread."""
    rows = stimuli[:, np.unique(stimuli.indices)].toarray().astype(np.float64)
    rows /= rows.sum(axis=1, keepdims=True)
    with one_thread():
        took, distances = _timed(lambda: _all_distances(rows))
        more, tree = _timed(lambda: minimum_spanning_tree(distances).tocoo())
        few, _ = _timed(lambda: squareform(pdist(rows[:SHARE], "jensenshannon")))
    few *= len(rows) * (len(rows) - 1) / (SHARE * (SHARE - 1))
    same = set(map(tuple, np.sort(np.stack([tree.row, tree.col], axis=1)).tolist())) == set(map(tuple, edges.tolist()))
    print(f"  the same edges as scipy's: {same}")
    for route, dense in (("numpy's logarithms", took + more), ("pdist(jensenshannon)", few + more)):
        ratio = f"{dense / processor:.0f} times our processor time, {dense / wall:.0f} times our wall time"
        print(f"  scipy, {route:<21} {dense:8.2f} s   {ratio}")


def _all_distances(rows: NDArray[np.float64], block: int = 64) -> NDArray[np.float64]:
    """JSD(p, q) = H((p + q) / 2) - (H(p) + H(q)) / 2 of every two, by numpy, in blocks that fit the cache."""
    size = len(rows)
    negentropy = np.einsum("ij,ij->i", rows, np.log(rows + TINY))
    out = np.zeros((size, size))
    for i in range(size):
        for first in range(i + 1, size, block):
            middle = rows[first : first + block] + rows[i]
            middle *= 0.5
            logarithm = np.log(middle + TINY)
            own = slice(first, first + len(middle))
            out[i, own] = (negentropy[i] + negentropy[own]) / 2 - np.einsum("ij,ij->i", middle, logarithm)
    return out + out.T


def _timed(work: Callable[[], Any]) -> tuple[float, Any]:
    began = time.process_time()
    result = work()
    return time.process_time() - began, result
