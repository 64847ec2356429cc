"""The depth image of a composition by casting rays with Open3D: no graphics driver is needed."""

from __future__ import annotations

import numpy as np
import open3d as o3d

from worker.simulation.camera import DepthImage, View, rays, window_of
from worker.simulation.compositions import Composition
from worker.simulation.params import CameraParams


def render(composition: Composition, view: View, params: CameraParams, chord: float) -> DepthImage:
    """The depth image of a composition; arguments as of `worker.simulation.scene.render`."""
    from_numpy = o3d.core.Tensor.from_numpy
    scene = o3d.t.geometry.RaycastingScene()
    meshes = view.meshes(composition, chord)
    for mesh in meshes:
        scene.add_triangles(from_numpy(mesh.vertices.astype(np.float32)), from_numpy(mesh.triangles.astype(np.uint32)))
    window = window_of(meshes, params)
    directions = rays(params, window)
    beams = np.zeros((*directions.shape[:2], 6), np.float32)
    beams[..., 3:] = directions
    hits = scene.cast_rays(from_numpy(beams), nthreads=1)  # the processes share the cores already
    # Rays have z = 1, so the distance along a ray in units of its length is the depth.
    reached = hits["t_hit"].numpy()
    missed = ~np.isfinite(reached)
    depth, labels = np.zeros((params.height, params.width)), np.full((params.height, params.width), -1)
    depth[window] = np.where(missed, 0.0, reached)
    labels[window] = np.where(missed, -1, hits["geometry_ids"].numpy().astype(np.int64))
    return DepthImage(depth, labels)
