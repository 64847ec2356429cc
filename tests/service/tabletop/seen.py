"""Table tops that the tests see for themselves: solids at known places, seen by the virtual depth camera."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import open3d as o3d
from numpy.typing import NDArray

from service.engine.cloud import PointCloud
from service.tabletop import Scene
from tests.benchmarks.scenes import overlap
from tests.shapes import ball, can, cube, look, see, table

VIEW = look(25, 40, 1.0)
PLACES = {1: (-0.12, 0.05), 2: (0.1, -0.1), 3: (0.1, 0.15)}  # of the solids, by their labels
SOLIDS = ((cube(0.08), 0.08, PLACES[1]), (can(0.035, 0.12), 0.12, PLACES[2]), (ball(0.04), 0.08, PLACES[3]))


AROUND = ((1.5, 0.0), (-2.0, 0.5), (0.3, 2.2), (-0.4, -2.8), (2.0, 2.0))  # of the blocks around a lidar


class Seen(NamedTuple):
    """A scene as a sensor sees it: the cloud, and the true object of each point (N,), 0 for what bears them."""

    cloud: PointCloud
    labels: NDArray[np.int64]


@cache
def set_table(noise: str = "none") -> Seen:
    """A cube, a can and a ball on a table of 60 cm, seen from a metre away."""
    measured = see(table(*SOLIDS), VIEW, noise)
    return Seen(measured.cloud, measured.labels.astype(np.int64))


@cache
def spin_lidar(rings: int = 64, around: int = 1800, noise: float = 0.01) -> Seen:
    """Blocks around a lidar a metre above a walled yard, z up; its rings look from 40 degrees down to 5 up."""
    yard = o3d.t.geometry.RaycastingScene()

    def add(size: tuple[float, float, float], centre: tuple[float, float, float]) -> int:
        solid = o3d.t.geometry.TriangleMesh.create_box(*size)
        return int(yard.add_triangles(solid.translate(np.array(centre) - np.array(size) / 2)))

    add((12, 12, 0.1), (0, 0, -1.05))
    for side in (-5, 5):
        add((0.1, 10, 3), (side, 0, 0))
        add((10, 0.1, 3), (0, side, 0))
    blocks = [add((0.25, 0.3, 0.4), (x, y, -0.8)) for x, y in AROUND]
    up, turn = np.meshgrid(
        np.radians(np.linspace(-40, 5, rings)), np.arange(around) / around * 2 * np.pi, indexing="ij"
    )
    rays = np.stack([np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), np.sin(up)], axis=-1).reshape(-1, 3)
    hits = yard.cast_rays(o3d.core.Tensor(np.concatenate([0 * rays, rays], axis=1).astype(np.float32)))
    ranges = hits["t_hit"].numpy().astype(float)
    met = np.isfinite(ranges)
    ranges += np.random.default_rng(0).normal(0, noise, len(ranges))
    labels = [
        dict(zip(blocks, range(1, 9), strict=False)).get(i, 0) for i in hits["geometry_ids"].numpy()[met].tolist()
    ]
    return Seen(PointCloud((rays * ranges[:, None])[met].astype(np.float32)), np.array(labels))


def overlaps(scene: Scene, labels: NDArray[np.int64]) -> list[float]:
    """How well the best of the found objects covers each true one."""
    return [
        max((overlap(np.flatnonzero(labels == number), found.indices) for found in scene.objects), default=0.0)
        for number in range(1, labels.max() + 1)
    ]


def flat(across: float, count: int = 20_000, seed: int = 0) -> NDArray[np.float64]:
    """Points (count, 3) of a square plane, metres, 0.5 m below a sensor and 1.5 m before it."""
    rng = np.random.default_rng(seed)
    x, z = rng.uniform(-across / 2, across / 2, (2, count))
    return np.stack([x, np.full(count, 0.5), 1.5 + z], axis=1)


def block(
    centre: tuple[float, float, float], size: tuple[float, float, float], count: int = 4000
) -> NDArray[np.float64]:
    """Points (count, 3) on the surface of a block along the axes, metres."""
    rng = np.random.default_rng(1)
    points = rng.uniform(-0.5, 0.5, (count, 3))
    axis = rng.integers(3, size=count)
    points[np.arange(count), axis] = rng.choice([-0.5, 0.5], count)
    return points * size + centre
