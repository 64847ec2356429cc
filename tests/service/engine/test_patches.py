"""Atomic patches: true normals, connected, on one side of a crease."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from service.engine.cloud import Frame, VoxelCloud, downsample, normalise
from service.engine.patches import Patches, estimate_normals, extract_patches
from tests.learnt import named_clouds
from tests.service.engine.seen import PARAMS, Seen, seen
from tests.shapes import about_optical_axis, ball, box, can, corner_view, cube, lid_view, look, stack

SOLIDS = {
    "a cube": (cube(0.12), corner_view(1, 0.9)),
    "a flat box": (box(0.05, 0.2, 0.15), corner_view(2, 0.8)),
    "a can": (can(0.05, 0.12), lid_view(3, 0.9)),
    "a ball": (ball(0.07), look(0, 30, 0.9)),
    "a ball on a box": (stack((box(0.15, 0.15, 0.1), (0, 0, 0)), (ball(0.05), (0, 0, 0.09))), look(30, 35, 0.9)),
}
solids = pytest.mark.parametrize("solid", SOLIDS)


def angles(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Between unit vectors, degrees."""
    return np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", a, b), -1, 1)))


@pytest.mark.parametrize(("noise", "median", "most"), [("none", 1.5, 12), ("kinect", 5, 15)])
@solids
def test_normals_are_those_of_the_solid(solid: str, noise: str, median: float, most: float):
    here = seen(*SOLIDS[solid], noise)
    off = angles(here.patches.normals, here.truth.normals)
    assert np.median(off) < median
    assert np.quantile(off, 0.85) < most


def test_normals_stay_sharp_beside_a_crease():
    here = seen(cube(0.12), corner_view(1, 0.9))
    off = angles(here.patches.normals, here.truth.normals)
    assert (off > 10).mean() < 0.06  # fits of one radius would blur a fifth of the cube


@solids
def test_normals_have_unit_length_and_look_at_the_sensor(solid: str):
    patches = seen(*SOLIDS[solid], "kinect").patches
    assert np.allclose(np.linalg.norm(patches.normals, axis=1), 1)
    sight = patches.cloud.frame.viewpoint - patches.cloud.points
    assert (np.einsum("ij,ij->i", patches.normals, sight) >= 0).all()


def strands(degrees: float) -> VoxelCloud:
    """Points on a few lines, as an edge-on face leaves them."""
    along = np.linspace(-0.5, 0.5, 40)[:, None]
    points = np.concatenate([along * [1, 0, 0] + [0, offset, 0.1 * offset] for offset in (-0.4, 0.0, 0.4)])
    axes = about_optical_axis(degrees)
    return VoxelCloud(points @ axes.T, np.zeros((len(points), 3), np.int32), 1 / 32, Frame(np.zeros(3), np.eye(3), 1.0))


def test_points_on_a_line_look_at_the_sensor_and_turn_with_the_cloud():
    clouds = [replace(strands(d), frame=Frame(np.array([0.0, 0.0, 2.0]), np.eye(3), 1.0)) for d in (0, 37)]
    straight, turned = (estimate_normals(cloud, 0.1) for cloud in clouds)
    assert np.allclose(straight @ about_optical_axis(37).T, turned, atol=1e-9)
    assert (straight[:, 2] < -0.9).all()


def test_a_thread_does_not_outvote_the_plane_it_ends_on():
    plane = np.stack([*np.meshgrid(np.arange(17), np.arange(17)), np.zeros((17, 17))], axis=-1).reshape(-1, 3) / 32
    thread = np.stack([np.linspace(17, 30, 14), np.full(14, 8.0), np.linspace(0, 2, 14)], axis=1) / 32
    frame = Frame(np.array([0.0, 0.0, 2.0]), np.eye(3), 1.0)
    cloud = VoxelCloud(np.concatenate([plane, thread]), np.zeros((303, 3), np.int32), 1 / 32, frame)
    assert angles(estimate_normals(cloud, 0.1)[:289], np.tile([[0, 0, -1.0]], (289, 1))).max() < 2


def parts(patches: Patches) -> int:
    """Number of connected parts of voxels that touch and share a label."""
    rows, columns = patches.adjacent.rows, patches.adjacent.indices
    same = patches.labels[rows] == patches.labels[columns]
    size = len(patches.labels)
    return int(connected_components(csr_array((same[same], (rows[same], columns[same])), shape=(size, size)))[0])


@pytest.mark.parametrize("noise", ["none", "kinect"])
@solids
def test_every_voxel_is_in_a_patch_and_every_patch_hangs_together(solid: str, noise: str):
    patches = seen(*SOLIDS[solid], noise).patches
    assert np.array_equal(np.unique(patches.labels), np.arange(patches.count))
    assert parts(patches) == patches.count


def purity(here: Seen) -> float:
    """Share of the voxels that lie on the most frequent true face of their patch."""
    labels, faces = here.patches.labels, here.truth.faces
    return sum(np.bincount(faces[labels == p]).max() for p in range(here.patches.count)) / len(labels)


@pytest.mark.parametrize(("noise", "least"), [("none", 0.97), ("kinect", 0.95)])
@solids
def test_patches_do_not_straddle_creases(solid: str, noise: str, least: float):
    assert purity(seen(*SOLIDS[solid], noise)) > least


@solids
def test_patches_are_small(solid: str):
    patches = seen(*SOLIDS[solid]).patches
    for label in range(0, patches.count, 5):
        inside = patches.cloud.points[patches.labels == label]
        assert np.linalg.norm(inside - inside.mean(axis=0), axis=1).max() < 2 * PARAMS.patches.seed


def test_islands_without_a_seed_become_patches_of_their_own():
    block = np.stack(np.meshgrid(*[np.arange(2)] * 3), axis=-1).reshape(-1, 3)
    cells = np.concatenate([block + np.array(place) for place in ([0, 0, 0], [5, 0, 0], [0, 9, 0])]).astype(np.int32)
    cloud = VoxelCloud(cells / 32, cells, 1 / 32, Frame(np.array([0.0, 0.0, 3.0]), np.eye(3), 1.0))
    patches = extract_patches(cloud, PARAMS.patches.model_copy(update={"seed": 0.5}))
    assert parts(patches) == patches.count >= 3


def test_rounding_does_not_decide_how_patches_grow():
    same = []
    for seed, named in enumerate(named_clouds()):
        cloud = downsample(normalise(named.cloud, PARAMS.cloud), PARAMS.cloud)
        jittered = replace(cloud, points=cloud.points + 1e-12 * np.random.default_rng(seed).random(cloud.points.shape))
        labels = [extract_patches(c, PARAMS.patches).labels for c in (cloud, jittered)]
        same.append(np.array_equal(*labels))
    assert all(same)
