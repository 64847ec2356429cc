"""The depth image of a composition by casting rays with Open3D: no graphics driver is needed."""

from __future__ import annotations

import numpy as np
import open3d as o3d

from worker.simulation.camera import DepthImage, View, rays
from worker.simulation.compositions import Composition
from worker.simulation.params import CameraParams


def render(composition: Composition, view: View, params: CameraParams, chord: float) -> DepthImage:
    """The depth image of a composition; arguments as of `worker.simulation.scene.render`."""
    from_numpy = o3d.core.Tensor.from_numpy
    scene = o3d.t.geometry.RaycastingScene()
    for mesh in view.meshes(composition, chord):
        scene.add_triangles(from_numpy(mesh.vertices.astype(np.float32)), from_numpy(mesh.triangles.astype(np.uint32)))
    directions = rays(params).astype(np.float32)
    hits = scene.cast_rays(from_numpy(np.concatenate([np.zeros_like(directions), directions], axis=-1)))
    # Rays have z = 1, so the distance along a ray in units of its length is the depth.
    depth = hits["t_hit"].numpy().astype(np.float64)
    missed = ~np.isfinite(depth)
    labels = hits["geometry_ids"].numpy().astype(np.int64)
    return DepthImage(np.where(missed, 0.0, depth), np.where(missed, -1, labels))
