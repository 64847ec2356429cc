"""A judge of solids that knows nothing but their triangles: Open3D's ray casting."""

from __future__ import annotations

import numpy as np
import open3d as o3d
from numpy.typing import NDArray

from worker.simulation.primitives import Mesh


def surfaces_cross(one: Mesh, other: Mesh) -> bool:
    """Whether the surfaces intersect: two triangles do where an edge of one passes through the other."""
    return _edges_pierce(one, other) or _edges_pierce(other, one)


def inside(solid: Mesh, points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N,) whether points (N, 3) lie in the solid."""
    return _scene(solid).compute_occupancy(_tensor(points), nsamples=3).numpy() > 0.5


def signed_distance(solid: Mesh, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) metres from the solid's triangles to points (N, 3), negative inside."""
    return _scene(solid).compute_signed_distance(_tensor(points), nsamples=3).numpy().astype(np.float64)


def spread(mesh: Mesh, count: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """(count, 3) points drawn uniformly from the triangles."""
    corners = mesh.vertices[mesh.triangles]  # (T, 3, 3)
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    chosen = corners[rng.choice(len(corners), count, p=areas / areas.sum())]
    weights = rng.dirichlet([1.0, 1.0, 1.0], count)  # uniform over a triangle
    return np.einsum("ij,ijk->ik", weights, chosen)


def volume(mesh: Mesh) -> float:
    """Cubic metres enclosed; negative where the triangles' normals point inwards."""
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def _edges_pierce(mesh: Mesh, other: Mesh) -> bool:
    sides = np.concatenate([mesh.triangles[:, [0, 1]], mesh.triangles[:, [1, 2]], mesh.triangles[:, [2, 0]]])
    sides = np.unique(np.sort(sides, axis=1), axis=0)
    starts, ends = mesh.vertices[sides[:, 0]], mesh.vertices[sides[:, 1]]
    hits = _scene(other).cast_rays(_tensor(np.concatenate([starts, ends - starts], axis=1)))
    return bool((hits["t_hit"].numpy() <= 1).any())


def _scene(mesh: Mesh) -> o3d.t.geometry.RaycastingScene:
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(_tensor(mesh.vertices), o3d.core.Tensor.from_numpy(mesh.triangles.astype(np.uint32)))
    return scene


def _tensor(values: NDArray[np.float64]) -> o3d.core.Tensor:
    return o3d.core.Tensor.from_numpy(np.ascontiguousarray(values, dtype=np.float32))
