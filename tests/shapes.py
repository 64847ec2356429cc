"""Shapes that the tests see for themselves: known solids, known poses, and true faces behind every point."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from service.engine.cloud import Frame, PointCloud
from worker.simulation.camera import View
from worker.simulation.compositions import Composition, Prototype
from worker.simulation.params import CameraParams, SimulationParams
from worker.simulation.raycast import render
from worker.simulation.sensor import Measurement, measure

CAMERA = CameraParams(width=320, height=320)  # the middle of a Kinect's image: objects stand there
KINECT = SimulationParams(noise="kinect", renderer="raycast", camera=CAMERA)
NOISELESS = SimulationParams(noise="none", renderer="raycast", camera=CAMERA)


def box(length: float, width: float, height: float) -> Composition:
    """A lone box, metres."""
    return Composition((Prototype("box", (length, width, height), np.eye(4)),))


def cube(edge: float) -> Composition:
    """A lone cube, metres."""
    return box(edge, edge, edge)


def can(radius: float, height: float) -> Composition:
    """A lone upright cylinder, metres."""
    return Composition((Prototype("cylinder", (radius, height), np.eye(4)),))


def ball(radius: float) -> Composition:
    """A lone sphere, metres."""
    return Composition((Prototype("sphere", (radius,), np.eye(4)),))


def stack(*parts: tuple[Composition, tuple[float, float, float]]) -> Composition:
    """Several solids as one, each moved, metres."""
    moved = []
    for part, place in parts:
        for prototype in part.prototypes:
            pose = prototype.pose.copy()
            pose[:3, 3] += place
            moved.append(Prototype(prototype.kind, prototype.dimensions, pose))
    return Composition(tuple(moved))


def table(*standing: tuple[Composition, float, tuple[float, float]], edge: float = 0.6) -> Composition:
    """A square table top, whose surface is the ground (z = 0), and solids that stand on it: each with its height and
    where its middle is, metres. The table is prototype 0; the solids, of one prototype each, follow.
    """
    parts = [(solid, (x, y, height / 2)) for solid, height, (x, y) in standing]
    return stack((box(edge, edge, 0.02), (0, 0, -0.01)), *parts)


def look(azimuth: float, elevation: float, distance: float, roll: float = 0.0) -> View:
    """The view of the composition's origin from an azimuth and elevation, degrees, at a distance, metres."""
    a, e, r = np.radians([azimuth, elevation, roll])
    forward = -np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    down = np.cross(forward, right)
    turned = np.cos(r) * right + np.sin(r) * down
    pose = np.eye(4)
    pose[:3, :3] = np.stack([turned, np.cross(forward, turned), forward], axis=1)
    pose[:3, 3] = -distance * forward
    return View(pose)


def see(composition: Composition, view: View, noise: str = "none", seed: int = 0) -> Measurement:
    """What a depth camera measures: `noise` is "none" or "kinect"."""
    params = NOISELESS if noise == "none" else KINECT
    image = render(composition, view, params.camera, 1e-5)
    return measure(image, composition, view, params, np.random.default_rng(seed))


class Truth(NamedTuple):
    """What is true at points of a cloud in its own frame: the face each lies on (M,), and the normal there (M, 3)."""

    faces: NDArray[np.int32]
    normals: NDArray[np.float64]


def truth(
    points: NDArray[np.float64], frame: Frame, measurement: Measurement, composition: Composition, view: View
) -> Truth:
    """What the nearest measured point tells of each point (M, 3) of the object's own frame."""
    near = cKDTree(measurement.cloud.points).query(frame.to_sensor(points))[1]
    labels = measurement.labels[near].astype(np.int64)
    normals = composition.normals(view.to_composition(measurement.cloud.points[near].astype(np.float64)), labels)
    return Truth(measurement.faces[near], normals @ view.pose[:3, :3] @ frame.axes)


def corner_view(seed: int, distance: float, least: float = 0.3) -> View:
    """A view of a cube that shows three faces, each at an angle whose cosine is at least `least`."""
    rng = np.random.default_rng(seed)
    while True:
        direction = rng.standard_normal(3)
        direction /= np.linalg.norm(direction)
        if np.abs(direction).min() >= least:
            return look(
                np.degrees(np.arctan2(direction[1], direction[0])),
                np.degrees(np.arcsin(direction[2])),
                distance,
                rng.uniform(0, 360),
            )


def lid_view(seed: int, distance: float, lowest: float = 20.0, highest: float = 60.0) -> View:
    """A view of an upright can that shows its side and its lid: an elevation between the two, degrees."""
    rng = np.random.default_rng(seed)
    return look(rng.uniform(0, 360), rng.uniform(lowest, highest), distance, rng.uniform(0, 360))


def rotation(seed: int) -> NDArray[np.float64]:
    """A random rotation (3, 3)."""
    q, r = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    q = q * np.sign(np.diag(r))
    q[:, 0] *= np.sign(np.linalg.det(q))
    return q


def about_optical_axis(degrees: float) -> NDArray[np.float64]:
    """A rotation about z (3, 3)."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def cloud_of(points: NDArray[np.float64]) -> PointCloud:
    """Points (N, 3), metres, as a cloud."""
    return PointCloud(np.asarray(points, dtype=np.float32))
