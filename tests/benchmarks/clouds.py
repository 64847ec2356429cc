"""The clouds that benchmarks run on: the real scans where they are present, simulated ones otherwise."""

from __future__ import annotations

from service import clouds
from service.clouds import ply
from service.engine.cloud import PointCloud
from tests.conftest import data_folder
from worker.simulation import simulate

EVERY = 6  # of the real scans
COUNT, SEED = 30, 11  # of the simulated ones


def benchmark_files() -> tuple[str, list[bytes]]:
    """What the clouds are, and their files: all real scans, or simulated objects."""
    files = sorted((data_folder() / "scans" / "objects").glob("*.ply"))
    if files:
        return f"{len(files)} real scans (`scans`)", [file.read_bytes() for file in files]
    simulated = simulate(COUNT, SEED, renderer="raycast")
    return f"{COUNT} simulated objects (seed {SEED})", [ply.write(one.cloud) for one in simulated]


def benchmark_clouds() -> tuple[str, list[PointCloud]]:
    """What the clouds are, and the clouds."""
    folder = data_folder() / "scans"
    files = sorted((folder / "objects").glob("*.ply"))[::EVERY]
    if files:
        return f"{len(files)} real scans (every {EVERY}th of `scans`)", [clouds.read(f.read_bytes()) for f in files]
    simulated = simulate(COUNT, SEED, renderer="raycast")
    return f"{COUNT} simulated objects (seed {SEED})", [one.cloud for one in simulated]
