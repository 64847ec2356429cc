"""How long an answer takes, against Open3D's voxel grid, normals and FPFH of the same cloud alone."""

from __future__ import annotations

import time
from collections.abc import Callable
from statistics import median

import open3d as o3d
from joblib import parallel_config
from threadpoolctl import threadpool_limits

from service.engine.cloud import PointCloud, downsample, normalise
from service.engine.model import ShapeModel
from service.engine.params import CloudParams, DescriptorParams, ModelParams, PatchParams
from tests.benchmarks.clouds import benchmark_clouds
from worker.learning.observations import NamedCloud
from worker.learning.train import train
from worker.simulation import simulate

OBJECTS, SEED = 250, 7
REPEATS = 3


def main() -> None:
    """Prints medians and their ratio."""
    data, clouds = benchmark_clouds()
    model = learn()
    answers, peers, stages = [], [], []
    with threadpool_limits(1):
        model.respond(clouds[0])  # compiles
        for cloud in clouds:
            answers.append(fastest(lambda cloud=cloud: model.respond(cloud)))
            peers.append(open3d_seconds(cloud))
            stages.append(stage_seconds(model, cloud))
    print(f"data: {data}; model of {OBJECTS} simulated objects; one thread; best of {REPEATS} a cloud, then medians")
    for stage in stages[0]:
        print(f"  {stage:<15} {1e3 * median(s[stage] for s in stages):8.1f} ms")
    ratio = median(a / p for a, p in zip(answers, peers, strict=True))
    print(f"  answer          {1e3 * median(answers):8.1f} ms")
    print(f"  Open3D          {1e3 * median(peers):8.1f} ms   voxel grid, normals, FPFH at one point a voxel")
    print(f"  answer / Open3D {ratio:8.2f}")


def learn() -> ShapeModel:
    """A model of simulated objects."""
    with parallel_config(backend="loky", n_jobs=2):
        clouds = (NamedCloud(str(o.index), o.cloud) for o in simulate(OBJECTS, SEED, renderer="raycast"))
        return train(clouds, ModelParams(), SEED).model


def open3d_seconds(cloud: PointCloud) -> float:
    """The peer's time, at the voxel size and radii that the answer uses."""
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


def stage_seconds(model: ShapeModel, cloud: PointCloud) -> dict[str, float]:
    """Time of each stage of one answer."""
    begun: list[tuple[str, float]] = []
    model.respond(cloud, on_stage=lambda stage: begun.append((stage, time.perf_counter())))
    ends = [start for _, start in begun[1:]] + [time.perf_counter()]
    return {stage: end - start for (stage, start), end in zip(begun, ends, strict=True)}


def fastest(work: Callable[[], object]) -> float:
    """The least of several times, seconds."""
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


if __name__ == "__main__":
    main()
