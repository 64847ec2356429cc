"""An object of a scene as the engine looks at it: the camera at the origin, turned to the object."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from service.engine.cloud import PointCloud
from service.tabletop.records import Plane, SceneObject

STRAIGHT = 1e-6  # sine of the angle to the plane's normal below which a line of sight is straight down


def cut_out(cloud: PointCloud, found: SceneObject, plane: Plane) -> PointCloud:
    """The points of an object as a camera sees it that is turned to it: the line of sight to its centroid is +z.

    Sensors that look all around have objects behind their origin; the engine knows cameras alone, which do not. The
    turned camera is upright: the plane's normal points up in its image.
    """
    axes = look_at(found.centroid, plane.normal)
    x, y, z = cloud.points[found.indices].astype(np.float64).T
    return PointCloud(np.stack([x * a[0] + y * a[1] + z * a[2] for a in axes], axis=1).astype(np.float32))


def look_at(target: NDArray[np.float64], up: NDArray[np.float64]) -> NDArray[np.float64]:
    """The axes right, down and forward (rows, (3, 3)) of a camera at the origin that looks at a target (3,)."""
    forward = target / np.linalg.norm(target)
    right = np.cross(forward, up)
    if np.linalg.norm(right) < STRAIGHT:
        right = np.cross(forward, np.eye(3)[np.argmin(np.abs(forward))])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(forward, right), forward])
