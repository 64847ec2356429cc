"""How many objects of real table-top scenes are found, against their labels: those that stand free, and others.

An object stands free if no point of another object is within 2 cm of any of its own. It is found if one of the found
objects has an overlap with it of at least one half: intersection over union, counted in measured points.
"""

from __future__ import annotations

import re
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from service import clouds
from service.clouds import lzf
from service.engine.cloud import PointCloud
from service.tabletop import Scene, find_objects
from tests.conftest import data_folder

FREE = 0.02  # metres
OVERLAP = 0.5
FIRST_OBJECT = 2  # labels are ten times a number, plus that of a part; 0 is nothing, less than 20 the table


class JudgedObject(NamedTuple):
    """A true object, and how well the best of the found objects covers it.

    Attributes:
        free: whether it stands free.
        overlap: intersection over union.
    """

    free: bool
    overlap: float


class JudgedScene(NamedTuple):
    """A scene, its true objects, how many were found in it, and how long that took, seconds."""

    name: str
    objects: list[JudgedObject]
    found: int
    seconds: float

    def share(self, free: bool) -> tuple[int, int]:
        """How many of the objects that stand free, or do not, are found, and how many there are."""
        asked = [one for one in self.objects if one.free == free]
        return sum(one.overlap >= OVERLAP for one in asked), len(asked)


def main(_: list[str]) -> None:
    """Prints a row for each scene, and the shares of all."""
    scenes = judge_all(data_folder() / "scenes")
    if not scenes:
        raise SystemExit(f"There are no scenes in {data_folder()}: set SHAPE_CONCEPTS_DATA to the folder of scans.")
    print(
        f"{'scene':10}{'true':>6}{'found':>7}{'free':>9}{'others':>9}{'seconds':>9}   overlap of each (* stands free)"
    )
    for scene in scenes:
        free, others = ("{}/{}".format(*scene.share(kind)) for kind in (True, False))
        overlaps = " ".join(f"{one.overlap:.2f}{'*' if one.free else ''}" for one in scene.objects)
        true = len(scene.objects)
        print(f"{scene.name:10}{true:6}{scene.found:7}{free:>9}{others:>9}{scene.seconds:9.2f}   {overlaps}")
    for kind, said in ((True, "stand free"), (False, "touch others or nearly")):
        found, true = np.sum([scene.share(kind) for scene in scenes], axis=0)
        print(f"objects that {said}: {found} of {true} found with an overlap of {OVERLAP} or more, {found / true:.0%}")


def judge_all(folder: Path) -> list[JudgedScene]:
    """Judges every scene of a folder."""
    return [_judge(file) for file in sorted(folder.glob("*.pcd"))]


def _judge(file: Path) -> JudgedScene:
    data = file.read_bytes()
    sent = clouds.read_scene(data)
    began = time.perf_counter()
    scene = find_objects(sent.cloud, width=sent.width)
    seconds = time.perf_counter() - began
    labels = read_labels(data) // 10
    own = labels if sent.cloud.measured is None else labels[sent.cloud.measured]
    return JudgedScene(file.stem, compare(sent.cloud, own, scene, FIRST_OBJECT), len(scene.objects), seconds)


def compare(cloud: PointCloud, labels: NDArray[np.int64], scene: Scene, first: int) -> list[JudgedObject]:
    """Judges a scene by the true object of each point (N,); numbers below `first` stand for no object."""
    true = [np.flatnonzero(labels == number) for number in np.unique(labels) if number >= first]
    trees = [cKDTree(cloud.points[rows]) for rows in true]
    judged = []
    for i, rows in enumerate(true):
        near = (tree.query(trees[i].data, distance_upper_bound=FREE)[0] for j, tree in enumerate(trees) if j != i)
        overlaps = [overlap(rows, found.indices) for found in scene.objects]
        judged.append(JudgedObject(not any(np.isfinite(each).any() for each in near), max(overlaps, default=0.0)))
    return judged


def overlap(one: NDArray[np.int64], other: NDArray[np.int64]) -> float:
    """Intersection over union of two sets of points."""
    both = len(np.intersect1d(one, other, assume_unique=True))
    return both / (len(one) + len(other) - both)


def read_labels(data: bytes) -> NDArray[np.int64]:
    """The field `label` (N,), which comes first, of a compressed PCD."""
    header = re.search(rb"FIELDS label .*POINTS (\d+)\nDATA binary_compressed\n", data, re.DOTALL)
    if header is None:
        raise ValueError("the scene is no compressed PCD that begins with labels")
    count, start = int(header[1]), header.end()
    packed, size = np.frombuffer(data, "<u4", 2, start).tolist()
    column = lzf.decompress(data[start + 8 : start + 8 + packed], 4 * count, size, "PCD")
    return column.view("<u4").astype(np.int64)


if __name__ == "__main__":
    main([])
