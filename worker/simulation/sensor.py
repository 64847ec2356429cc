"""What a depth sensor makes of a true depth image: a cloud, with the noise of a Kinect or with none.

Nguyen, Izadi and Lovell, "Modeling Kinect sensor noise for improved 3D reconstruction and tracking", 3DIMPVT 2012,
measured the noise across and along the optical axis against the surface's distance and angle.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from service.engine.cloud import PointCloud
from worker.simulation.camera import DepthImage, View, rays
from worker.simulation.compositions import Composition
from worker.simulation.params import SimulationParams

MARGIN = 8  # pixels around the object into which lateral noise may carry its silhouette


class Measurement(NamedTuple):
    """A cloud, and what is true of each of its points.

    Attributes:
        cloud: what the sensor measured, in the camera's frame, row by row of the depth image.
        labels: (N,) int32, index of the prototype that each point was measured on.
        faces: (N,) int32, the smooth face it was measured on, numbered through the composition.
    """

    cloud: PointCloud
    labels: NDArray[np.int32]
    faces: NDArray[np.int32]


class _Pixels(NamedTuple):
    """The part of a depth image that holds the object, (h, w) each, and (h, w, 3) for the rays."""

    depth: NDArray[np.float64]
    rays: NDArray[np.float64]
    labels: NDArray[np.int64]
    faces: NDArray[np.int64]
    angle: NDArray[np.float64]


def measure(
    image: DepthImage, composition: Composition, view: View, params: SimulationParams, rng: np.random.Generator
) -> Measurement:
    """Turns a true depth image into the cloud that a sensor with `params.noise` would give."""
    pixels = _pixels(image, composition, view, params)
    if params.noise == "kinect":
        pixels = _blur_across(pixels, params, rng)
        depth = _blur_along(pixels, params, rng)
        depth[pixels.angle > np.radians(params.sensor.grazing)] = 0
    else:
        depth = pixels.depth
    returned = depth > 0
    points = pixels.rays[returned] * depth[returned, None]
    return Measurement(
        PointCloud(points.astype(np.float32)),
        pixels.labels[returned].astype(np.int32),
        pixels.faces[returned].astype(np.int32),
    )


def axial_sigma(depth: NDArray[np.float64], angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Standard deviation of the measured depth, metres (Nguyen 2012).

    sigma_z = 0.0012 + 0.0019 (z - 0.4)^2 + 0.0001 / sqrt(z) theta^2 / (pi/2 - theta)^2

    Args:
        depth: z, metres, positive.
        angle: theta between the surface's normal and the line of sight, radians, below pi/2.
    """
    return 0.0012 + 0.0019 * (depth - 0.4) ** 2 + 0.0001 / np.sqrt(depth) * (angle / (np.pi / 2 - angle)) ** 2


def lateral_sigma(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Standard deviation of where an edge is seen, pixels (Nguyen 2012): 0.8 + 0.035 theta / (pi/2 - theta)."""
    return 0.8 + 0.035 * angle / (np.pi / 2 - angle)


def disparity_step(depth: NDArray[np.float64], params: SimulationParams) -> NDArray[np.float64]:
    """Distance between neighbouring depths that the sensor tells apart, metres: z^2 / (f b steps)."""
    return depth**2 / (params.camera.focal * params.sensor.baseline * params.sensor.disparity_steps)


def _pixels(image: DepthImage, composition: Composition, view: View, params: SimulationParams) -> _Pixels:
    """Cuts the object out of the image and finds what each pixel truly sees."""
    window = _window(image.labels >= 0)
    depth, labels, directions = image.depth[window], image.labels[window], rays(params.camera, window)
    seen = labels >= 0
    along, on = directions[seen], labels[seen]
    points = view.to_composition(along * depth[seen][:, None])
    faces = np.full(labels.shape, -1, dtype=np.int64)
    faces[seen] = composition.faces(points, on)
    length = np.sqrt(along[:, 0] ** 2 + along[:, 1] ** 2 + along[:, 2] ** 2)
    sight = along / length[:, None] @ view.pose[:3, :3].T
    cosine = np.abs(np.einsum("ij,ij->i", composition.normals(points, on), sight))
    angle = np.zeros(labels.shape)
    angle[seen] = np.arccos(np.minimum(cosine, 1.0))
    return _Pixels(depth, directions, labels, faces, angle)


def _window(seen: NDArray[np.bool_]) -> tuple[slice, slice]:
    """The rows and columns that hold the object and a margin around it."""
    if not seen.any():
        return slice(0, 0), slice(0, 0)
    spans = []
    for axis in (1, 0):
        used = np.flatnonzero(seen.any(axis=axis))
        spans.append(slice(max(0, used[0] - MARGIN), used[-1] + 1 + MARGIN))
    return spans[0], spans[1]


def _blur_across(pixels: _Pixels, params: SimulationParams, rng: np.random.Generator) -> _Pixels:
    """Lateral noise: a pixel reads the surface that a pixel at a random displacement sees.

    Where that is the face it sees itself, its reading stays: the noise within a face is what `axial_sigma` measured.
    Only the borders of faces, where lateral noise was measured, become ragged.
    """
    height, width = pixels.depth.shape
    sigma = lateral_sigma(np.minimum(pixels.angle, np.radians(params.sensor.grazing)))
    down, right = np.rint(sigma * rng.standard_normal((2, height, width))).astype(np.int64)
    rows = np.clip(np.arange(height)[:, None] + down, 0, height - 1)
    columns = np.clip(np.arange(width) + right, 0, width - 1)
    seen = (rows * width + columns).ravel()
    moves = np.flatnonzero(pixels.faces.ravel()[seen] != pixels.faces.ravel())
    seen = seen[moves]
    depth, labels = pixels.depth.copy(order="C"), pixels.labels.copy(order="C")
    faces, angle = pixels.faces.copy(order="C"), pixels.angle.copy(order="C")
    for read in (depth, labels, faces, angle):
        read.ravel()[moves] = read.ravel()[seen]
    return _Pixels(depth, pixels.rays, labels, faces, angle)


def _blur_along(pixels: _Pixels, params: SimulationParams, rng: np.random.Generator) -> NDArray[np.float64]:
    """Axial noise and disparity steps; (h, w) depths, metres, 0 where nothing is.

    The published deviation was measured on depths that were already stepped: rounding's share, step^2 / 12, is taken
    off the Gaussian's variance, so that both together have it.
    """
    depth = np.zeros_like(pixels.depth)
    seen = pixels.depth > 0
    true = pixels.depth[seen]
    angle = np.minimum(pixels.angle[seen], np.radians(params.sensor.grazing))
    variance = axial_sigma(true, angle) ** 2 - disparity_step(true, params) ** 2 / 12
    measured = true + np.sqrt(np.maximum(variance, 0)) * rng.standard_normal(pixels.depth.shape)[seen]
    scale = params.camera.focal * params.sensor.baseline * params.sensor.disparity_steps
    steps = np.rint(scale / np.maximum(measured, 1e-3))
    depth[seen] = scale / np.maximum(steps, 1)
    return depth
