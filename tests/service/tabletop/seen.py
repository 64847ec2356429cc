"""Table tops that the tests see for themselves: solids at known places, seen by the virtual depth camera."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from service.engine.cloud import PointCloud
from service.tabletop import Scene
from tests.benchmarks.scenes import overlap
from tests.shapes import ball, can, cube, look, see, table
from worker.simulation.camera import View

VIEW = look(25, 40, 1.0)
PLACES = {1: (-0.12, 0.05), 2: (0.1, -0.1), 3: (0.1, 0.15)}  # of the solids, by their labels
SOLIDS = ((cube(0.08), 0.08, PLACES[1]), (can(0.035, 0.12), 0.12, PLACES[2]), (ball(0.04), 0.08, PLACES[3]))


class Seen(NamedTuple):
    """A table top as the camera sees it: the cloud, and the true object of each point (N,), 0 for the table."""

    cloud: PointCloud
    labels: NDArray[np.int64]
    view: View


@cache
def set_table(noise: str = "none") -> Seen:
    """A cube, a can and a ball on a table of 60 cm, seen from a metre away."""
    measured = see(table(*SOLIDS), VIEW, noise)
    return Seen(measured.cloud, measured.labels.astype(np.int64), VIEW)


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
