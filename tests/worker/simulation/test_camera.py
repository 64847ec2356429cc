from __future__ import annotations

import numpy as np
import pytest

from worker.simulation.camera import draw_view, rays
from worker.simulation.compositions import compose
from worker.simulation.params import CameraParams, PrototypeParams
from worker.simulation.raycast import render

CAMERA = CameraParams()


def test_a_view_is_a_rigid_pose_that_looks_at_the_middle_from_above() -> None:
    rng = np.random.default_rng(0)
    composition = compose(2, PrototypeParams(), rng)
    middle, _ = composition.bounding_sphere()
    for _ in range(50):
        pose = draw_view(composition, CAMERA, rng).pose
        turn, place = pose[:3, :3], pose[:3, 3]
        assert turn @ turn.T == pytest.approx(np.eye(3), abs=1e-12)
        assert np.linalg.det(turn) == pytest.approx(1)
        distance = np.linalg.norm(place - middle)
        assert CAMERA.nearest <= distance <= CAMERA.farthest
        assert place + distance * turn[:, 2] == pytest.approx(middle)
        assert place[2] >= middle[2]
        assert turn[2, 0] == 0  # the horizon is level
        assert turn[2, 1] <= 0  # down is down


@pytest.mark.parametrize(("lowest", "mean"), [(0, 0.5), (-90, 0.0)])
def test_views_are_even_over_the_sphere(lowest: float, mean: float) -> None:
    rng = np.random.default_rng(1)
    composition = compose(1, PrototypeParams(), rng)
    camera = CameraParams(lowest=lowest)
    upward = np.array([-draw_view(composition, camera, rng).pose[:3, 2] for _ in range(2000)])
    # The height of a point uniform on a sphere is uniform (Archimedes).
    assert upward.mean(axis=0) == pytest.approx([0, 0, mean], abs=0.05)
    assert np.quantile(upward[:, 2], 0.25) == pytest.approx((np.sin(np.radians(lowest)) + mean) / 2, abs=0.05)
    quarters = np.bincount((np.arctan2(upward[:, 1], upward[:, 0]) // (np.pi / 2)).astype(int) + 2, minlength=4)
    assert quarters == pytest.approx(500, abs=80)


@pytest.mark.parametrize(
    "camera",
    [CAMERA, CameraParams(width=64, height=320), CameraParams(focal=100), CameraParams(focal=2000)],
    ids=["kinect", "narrow", "wide-angle", "long"],
)
def test_the_whole_object_is_in_the_image(camera: CameraParams) -> None:
    rng = np.random.default_rng(2)
    for _ in range(6):
        composition = compose(5, PrototypeParams(), rng)
        labels = render(composition, draw_view(composition, camera, rng), camera, 1e-3).labels
        border = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
        assert (border == -1).all()
        assert (labels >= 0).any()


def test_meshes_are_carried_into_the_cameras_frame_and_back() -> None:
    rng = np.random.default_rng(3)
    composition = compose(3, PrototypeParams(), rng)
    view = draw_view(composition, CAMERA, rng)
    for mesh, prototype in zip(view.meshes(composition, 1e-3), composition.prototypes, strict=True):
        there = prototype.mesh(1e-3)
        assert mesh.vertices[:, 2].min() > 0
        assert np.array_equal(mesh.triangles, there.triangles)
        assert view.to_composition(mesh.vertices) == pytest.approx(there.vertices, abs=1e-12)


def test_rays_go_through_the_middles_of_pixels() -> None:
    camera = CameraParams(width=32, height=16, focal=10)
    directions = rays(camera)
    assert directions.shape == (16, 32, 3)
    assert directions[0, 0] == pytest.approx([-1.55, -0.75, 1])
    assert directions.sum(axis=(0, 1)) == pytest.approx([0, 0, 16 * 32])
