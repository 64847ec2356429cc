"""How long an answer takes, from the bytes of a file to the response, on one thread: `./run bench`.

Against it stand Open3D's voxel grid, normals and FPFH of the same cloud, and, where its program is named, PCL's
supervoxels, normals, merge and FPFH. A profile tells what each stage and each function of it takes.
"""

from __future__ import annotations

import argparse
import cProfile
import json
import pstats
import subprocess
import tempfile
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import open3d as o3d
from joblib import parallel_config
from threadpoolctl import threadpool_limits

from service import clouds
from service.engine.cloud import PointCloud, downsample, normalise
from service.engine.model import ShapeModel
from service.engine.params import CloudParams, DescriptorParams, ModelParams, PatchParams
from service.store import ModelStore
from tests.benchmarks.clouds import benchmark_files
from worker.learning.observations import NamedCloud
from worker.learning.train import train
from worker.simulation import simulate

OBJECTS, SEED = 250, 7
REPEATS = 5
PCL = ["0.006", "0.02", "--mode", "smooth", "--angle", "15", "--min", "5", "--threads", "1"]
MILLION = 1_000_000
FUNCTIONS = 30  # of a profile


class Times(NamedTuple):
    """Of one cloud, seconds; the least of several tries.

    Attributes:
        answer: from bytes to response.
        stages: of the fastest answer.
        open3d: of the peer.
        pcl: of the peer, without loading; None where its program was not named.
        large: of the answer of another, larger model; None where none was named.
    """

    answer: float
    stages: dict[str, float]
    open3d: float
    pcl: float | None
    large: float | None


def main(arguments: list[str]) -> None:
    """Prints medians, 99th percentiles and ratios."""
    parser = argparse.ArgumentParser(prog="./run bench", description=__doc__)
    parser.add_argument("--pcl", help="the program pclpeer: PCL's supervoxels, normals, merge and FPFH")
    parser.add_argument("--large", nargs=2, metavar=("STORE", "MODEL"), help="a model of many objects, to compare with")
    parser.add_argument("--profile", action="store_true", help="only the profile of the functions")
    asked = parser.parse_args(arguments)
    data, files = benchmark_files()
    model = learn()
    large = _load(*asked.large) if asked.large else None
    with threadpool_limits(1):
        if asked.profile:
            profile(model, files)
            return
        times = [measure(model, large, file, asked.pcl) for file in files]
        print(f"data: {data}; model of {OBJECTS} simulated objects; one thread; best of {REPEATS} a cloud")
        _report(times)
        _report_million(model)


def learn() -> ShapeModel:
    """A model of simulated objects."""
    with parallel_config(backend="loky", n_jobs=2):
        named = (NamedCloud(str(o.index), o.cloud) for o in simulate(OBJECTS, SEED, renderer="raycast"))
        return train(named, ModelParams(), SEED).model


def measure(model: ShapeModel, large: ShapeModel | None, file: bytes, pcl: str | None) -> Times:
    """Our answers and the peers', one after the other, so that both see the same machine."""
    cloud = clouds.read(file)
    best = min((_stages(model, file) for _ in range(REPEATS)), key=lambda stages: sum(stages.values()))
    return Times(
        answer=sum(best.values()),
        stages=best,
        open3d=open3d_seconds(cloud),
        pcl=pcl_seconds(pcl, cloud) if pcl else None,
        large=fastest(lambda: large.respond(clouds.read(file))) if large else None,
    )


def open3d_seconds(cloud: PointCloud) -> float:
    """Voxel grid, normals and FPFH, at the voxel size and radii that the answer uses."""
    extent = normalise(cloud, CloudParams()).frame.extent
    voxel = downsample(normalise(cloud, CloudParams()), CloudParams()).size * extent
    normal_radius = PatchParams().normal_radius * extent
    fpfh_radius = max(DescriptorParams().fpfh_radius * extent, 3 * voxel)
    points = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud.points.astype(float)))

    def describe() -> None:
        small = points.voxel_down_sample(voxel)
        small.estimate_normals(o3d.geometry.KDTreeSearchParamRadius(normal_radius))
        o3d.pipelines.registration.compute_fpfh_feature(small, o3d.geometry.KDTreeSearchParamRadius(fpfh_radius))

    return fastest(describe)


def pcl_seconds(program: str, cloud: PointCloud) -> float:
    """Supervoxels, normals, merge and FPFH, by the program's own clock; loading is not counted."""
    with tempfile.NamedTemporaryFile(suffix=".pcd") as file:
        points = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud.points.astype(float)))
        o3d.io.write_point_cloud(file.name, points)
        told = [
            json.loads(subprocess.run([program, file.name, *PCL], capture_output=True, check=True).stdout)["ms"]
            for _ in range(REPEATS)
        ]
    return min(sum(spent for stage, spent in each.items() if stage != "load") for each in told) / 1e3


def profile(model: ShapeModel, files: list[bytes]) -> None:
    """Where the time goes, function by function; compiled ones are told like any other."""
    for file in files:
        model.respond(clouds.read(file))
    profiler = cProfile.Profile()
    profiler.enable()
    for file in files:
        model.respond(clouds.read(file))
    profiler.disable()
    print(f"{len(files)} answers")
    pstats.Stats(profiler).sort_stats("tottime").print_stats(FUNCTIONS)


def fastest(work: Callable[[], object]) -> float:
    """The least of several times, seconds."""
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def _load(store: str, model: str) -> ShapeModel:
    models = ModelStore(store)
    return models.load(*models.resolve(model))[0]


def _stages(model: ShapeModel, file: bytes) -> dict[str, float]:
    """Time of each stage of one answer, seconds."""
    begun = [("decode", time.perf_counter())]
    cloud = clouds.read(file)
    model.respond(cloud, on_stage=lambda stage: begun.append((stage, time.perf_counter())))
    ends = [start for _, start in begun[1:]] + [time.perf_counter()]
    return {stage: end - start for (stage, start), end in zip(begun, ends, strict=True)}


def _report(times: list[Times]) -> None:
    for stage in times[0].stages:
        print(f"  {stage:<24}{1e3 * np.median([t.stages[stage] for t in times]):8.2f} ms")
    answers = np.array([t.answer for t in times])
    _print_row("answer", answers)
    for name, peer in (
        ("Open3D", [t.open3d for t in times]),
        ("PCL", [t.pcl for t in times]),
        ("answer of the large model", [t.large for t in times]),
    ):
        if None not in peer:
            _print_row(name, np.array(peer), answers)


def _print_row(name: str, seconds: np.ndarray, answers: np.ndarray | None = None) -> None:
    median, slow = 1e3 * np.median(seconds), 1e3 * np.quantile(seconds, 0.99)
    row = f"  {name:<26}{median:8.2f} ms, 99th percentile {slow:8.2f} ms"
    if answers is not None:
        times = np.median(seconds) / np.median(answers), np.quantile(seconds, 0.99) / np.quantile(answers, 0.99)
        row += (
            f"; times the answer: {times[0]:.2f}, {times[1]:.2f}; median over clouds {np.median(seconds / answers):.2f}"
        )
    print(row)


def _report_million(model: ShapeModel) -> None:
    """A box seen at a corner in a million points, against Open3D's voxel grid alone, a single pass."""
    rng = np.random.default_rng(SEED)
    face, points = rng.integers(0, 3, MILLION), rng.random((MILLION, 3)) * [0.3, 0.2, 0.1]
    points[np.arange(MILLION), face] = 0.0
    cloud = PointCloud((points @ _corner() + [0, 0, 1]).astype(np.float32))
    theirs = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud.points.astype(float)))
    ours, grid = fastest(lambda: model.respond(cloud)), fastest(lambda: theirs.voxel_down_sample(0.3 / 32))
    print(f"  a million points: {1e3 * ours:.0f} ms; Open3D's voxel grid {1e3 * grid:.0f} ms; ratio {ours / grid:.2f}")


def _corner() -> np.ndarray:
    """Turns the corner of a box towards the sensor (3, 3)."""
    towards = np.array([1.0, 1.0, 1.0]) / np.sqrt(3)
    across = np.array([1.0, -1.0, 0.0]) / np.sqrt(2)
    return np.stack([across, np.cross(towards, across), towards], axis=1)
