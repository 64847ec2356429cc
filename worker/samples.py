"""The clouds that the page offers to try: simulated objects, and some of them on a table. Made by `./run samples`."""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from service.clouds import write_ply
from service.engine.cloud import PointCloud
from worker.simulation import Composition, Prototype, SimulatedObject, SimulationParams, View, simulate
from worker.simulation.params import CameraParams
from worker.simulation.raycast import render
from worker.simulation.sensor import measure

FOLDER = Path("service/web/samples")
INDEX = "index.json"
SEED = 2030  # not that of the built-in model: it has seen none of these
ORDERS = (1, 2, 3, 4)
STANDING = ((-0.24, -0.12), (0.02, 0.2), (0.2, -0.17))  # where objects of the scene stand on the table, metres
COUNTS = {2: "two", 3: "three", 4: "four"}
PLURALS = {"box": "boxes", "cylinder": "cylinders", "sphere": "spheres"}
TABLE = (0.9, 0.8, 0.02)  # metres
OBJECTS = SimulationParams(renderer="raycast", orders=ORDERS, camera=CameraParams(nearest=0.8, farthest=1.0, lowest=25))
SCENE = SimulationParams(renderer="raycast", camera=CameraParams(width=400, height=300, focal=330))


class Sample(NamedTuple):
    """A cloud to try.

    Attributes:
        file: name of its file.
        title: what it shows.
        scene: whether it is a whole scene.
        cloud: as the virtual sensor saw it.
    """

    file: str
    title: str
    scene: bool
    cloud: PointCloud


def make() -> Iterator[Sample]:
    """The samples: an object of each prototype order, and a scene of others."""
    made = list(simulate(len(ORDERS) + len(STANDING), SEED, params=OBJECTS, workers=1))
    for simulated in made[: len(ORDERS)]:
        yield Sample(f"object-{simulated.order}.ply", _title(simulated), False, simulated.cloud)
    title = "Three objects on a table"
    yield Sample("scene.ply", title, True, _set_table(made[len(ORDERS) :]))


def write(folder: Path) -> None:
    """Writes the samples, and an index of them, into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    index = []
    for sample in make():
        (folder / sample.file).write_bytes(write_ply(sample.cloud))
        index.append(
            {
                "file": sample.file,
                "title": sample.title,
                "scene": sample.scene,
                "points": len(sample.cloud.points),
            }
        )
    (folder / INDEX).write_text(json.dumps(index, indent=1) + "\n")


def _title(simulated: SimulatedObject) -> str:
    """The prototypes in words: "Two boxes and a sphere"."""
    kinds = Counter(prototype.kind for prototype in simulated.composition.prototypes)
    words = [f"a {kind}" if count == 1 else f"{COUNTS[count]} {PLURALS[kind]}" for kind, count in kinds.items()]
    return (", ".join(words[:-1]) + " and " * (len(words) > 1) + words[-1]).capitalize()


def _set_table(objects: list[SimulatedObject]) -> PointCloud:
    """The objects on a table, seen by a depth camera from in front and above."""
    top = np.eye(4)
    top[2, 3] = -TABLE[2] / 2
    prototypes = [Prototype("box", TABLE, top)]
    for simulated, (x, y) in zip(objects, STANDING, strict=True):
        parts = simulated.composition.prototypes
        lowest = min(prototype.surface()[:, 2].min() for prototype in parts)
        for prototype in parts:
            pose = prototype.pose.copy()
            pose[:3, 3] += (x, y, -lowest)
            prototypes.append(Prototype(prototype.kind, prototype.dimensions, pose))
    scene, view = Composition(tuple(prototypes)), _look_down(35, 1.15)
    image = render(scene, view, SCENE.camera, SCENE.prototypes.chord)
    return measure(image, scene, view, SCENE, np.random.default_rng(SEED)).cloud


def _look_down(elevation: float, distance: float) -> View:
    """The view of the table's middle from so many degrees above it, at a distance, metres."""
    up = np.radians(elevation)
    forward = np.array([-np.cos(up), 0, -np.sin(up)])
    right = np.array([0.0, 1.0, 0.0])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = -distance * forward + (0, 0, 0.05)
    return View(pose)


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
