"""The virtual depth camera: where it stands, what its pixels look along, and the image it takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from worker.simulation.compositions import Composition
from worker.simulation.params import CameraParams
from worker.simulation.primitives import Mesh

CLOSE = 1e-3  # metres: nothing nearer to the camera is projected


@dataclass(frozen=True)
class View:
    """From where an object is seen.

    Attributes:
        pose: (4, 4) float64 from the camera's frame (x right, y down, z forward) to the composition's, metres.
    """

    pose: NDArray[np.float64]

    def to_composition(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (N, 3) of the camera's frame in the composition's, metres."""
        return points @ self.pose[:3, :3].T + self.pose[:3, 3]

    def meshes(self, composition: Composition, chord: float) -> list[Mesh]:
        """The prototypes' meshes in the camera's frame."""
        meshes = (prototype.mesh(chord) for prototype in composition.prototypes)
        return [Mesh((mesh.vertices - self.pose[:3, 3]) @ self.pose[:3, :3], mesh.triangles) for mesh in meshes]


class DepthImage(NamedTuple):
    """What a camera without noise sees.

    Attributes:
        depth: (H, W) float64, metres along the optical axis at the pixels' middles; 0 where nothing is.
        labels: (H, W) int64, index of the prototype seen; -1 where nothing is.
    """

    depth: NDArray[np.float64]
    labels: NDArray[np.int64]


def draw_view(composition: Composition, params: CameraParams, rng: np.random.Generator) -> View:
    """A view on the middle of the object, uniform over the half sphere above it.

    The first prototype lies upright and all others have random orientations, so a composition is as likely as its
    half turn about a horizontal axis: views from below would show nothing else, only upside down.
    """
    middle, radius = composition.bounding_sphere()
    narrow = np.arctan(min(params.width, params.height) / 2 / params.focal)
    nearest = max(params.nearest, 1.02 * radius / np.sin(narrow))
    distance = rng.uniform(nearest, max(params.farthest, nearest))
    azimuth = rng.uniform(0, 2 * np.pi)
    sine = rng.uniform(np.sin(np.radians(params.lowest)), 1)
    cosine = np.sqrt(1 - sine**2)
    forward = -np.array([cosine * np.cos(azimuth), cosine * np.sin(azimuth), sine])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = middle - distance * forward
    return View(pose)


Window = tuple[slice, slice]
"""Rows and columns of an image."""

EVERYTHING: Window = (slice(None), slice(None))


def rays(params: CameraParams, window: Window = EVERYTHING) -> NDArray[np.float64]:
    """(h, w, 3) what the middle of each pixel of a window looks along, in the camera's frame, with z = 1."""
    u = ((np.arange(params.width) + 0.5 - params.width / 2) / params.focal)[window[1]]
    v = ((np.arange(params.height) + 0.5 - params.height / 2) / params.focal)[window[0]]
    out = np.ones((len(v), len(u), 3))
    out[..., 0], out[..., 1] = u, v[:, None]
    return out


def window_of(meshes: Sequence[Mesh], params: CameraParams) -> Window:
    """The pixels that meshes in the camera's frame can be seen in; all of them if a mesh reaches behind the camera."""
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    if vertices[:, 2].min() <= CLOSE:
        return EVERYTHING
    across = vertices[:, :2] / vertices[:, 2:] * params.focal
    spans = []
    for axis, size in ((1, params.height), (0, params.width)):
        low, high = across[:, axis].min() + size / 2, across[:, axis].max() + size / 2
        spans.append(slice(int(np.clip(low - 1, 0, size)), int(np.clip(high + 2, 0, size))))
    return spans[0], spans[1]
