"""The virtual Kinect against what Nguyen, Izadi and Lovell (3DIMPVT 2012) measured on a real one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion

from service.engine.cloud import PointCloud
from tests.shapes import CAMERA, KINECT, NOISELESS, ball, box, look, see, stack
from worker.simulation.camera import DepthImage, View
from worker.simulation.compositions import Composition
from worker.simulation.params import SensorParams, SimulationParams
from worker.simulation.raycast import render
from worker.simulation.sensor import axial_sigma, disparity_step, lateral_sigma, measure

STEPS = 525 * 0.075 * 8  # eighths of a pixel of disparity at a metre, of a focal length of 525 pixels and 7.5 cm


def pixels_of(cloud: PointCloud) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(N,) rows and columns of the pixels that measured the points."""
    x, y, z = cloud.points.astype(np.float64).T
    columns, rows = x / z * CAMERA.focal + CAMERA.width / 2 - 0.5, y / z * CAMERA.focal + CAMERA.height / 2 - 0.5
    assert np.abs(columns - np.rint(columns)).max() < 1e-3, "a point is not on the ray of a pixel"
    assert np.abs(rows - np.rint(rows)).max() < 1e-3, "a point is not on the ray of a pixel"
    return np.rint(rows).astype(np.int64), np.rint(columns).astype(np.int64)


class Plate(NamedTuple):
    """A plate seen under a tilt: its picture without noise, and what of it is far from its edges."""

    solid: Composition
    view: View
    image: DepthImage
    inner: NDArray[np.bool_]


def plate(tilt: float, distance: float, size: float = 0.5) -> Plate:
    solid, view = box(size, size, 0.001), look(0, 90 - tilt, distance)
    image = render(solid, view, CAMERA, 1e-4)
    return Plate(solid, view, image, binary_erosion(image.labels >= 0, iterations=8))


def errors(tilt: float, distance: float, seed: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(M,) measured less true depth well within a tilted plate, and the deviation published for it, metres."""
    seen = plate(tilt, distance)
    cloud = measure(seen.image, seen.solid, seen.view, KINECT, np.random.default_rng(seed)).cloud
    rows, columns = pixels_of(cloud)
    inner = seen.inner[rows, columns]
    points, true = cloud.points.astype(np.float64)[inner], seen.image.depth[rows, columns][inner]
    normal = seen.view.pose[:3, :3].T @ [0, 0, 1]
    theta = np.arccos(np.abs(points @ normal) / np.linalg.norm(points, axis=1))
    published = 0.0012 + 0.0019 * (true - 0.4) ** 2 + 0.0001 / np.sqrt(true) * theta**2 / (np.pi / 2 - theta) ** 2
    return points[:, 2] - true, published


@pytest.mark.parametrize("distance", [0.6, 1.0, 1.5])
@pytest.mark.parametrize("tilt", [0, 30, 60, 72])
def test_depths_deviate_as_published(tilt: float, distance: float) -> None:
    # At one depth, rounding to steps takes more or less of the deviation: the mean over a step counts.
    near = distance + np.linspace(-0.5, 0.5, 4, endpoint=False) * distance**2 / STEPS
    error, published = map(np.concatenate, zip(*(errors(tilt, d, i) for i, d in enumerate(near)), strict=True))
    assert len(error) > 2000
    assert np.std(error / published) == pytest.approx(1, abs=0.1)
    assert abs(np.mean(error / published)) < 0.1


def test_deviations_known_by_heart() -> None:
    at = np.array([0.4, 1.0, 1.4])
    assert axial_sigma(at, np.zeros(3)) == pytest.approx([0.0012, 0.001884, 0.0031])
    # At half of a right angle theta / (pi/2 - theta) is 1, at 60 degrees 2, at 80 degrees 8.
    angles = np.radians([0, 45, 60, 80])
    assert axial_sigma(np.ones(4), angles) - 0.001884 == pytest.approx([0, 0.0001, 0.0004, 0.0064])
    assert lateral_sigma(angles) == pytest.approx([0.8, 0.835, 0.87, 1.08])


@pytest.mark.parametrize("tilt", [0, 50])
def test_all_depths_are_whole_eighths_of_a_pixel_of_disparity(tilt: float) -> None:
    seen = plate(tilt, 1.0)
    cloud = measure(seen.image, seen.solid, seen.view, KINECT, np.random.default_rng(0)).cloud
    steps = STEPS / cloud.points[:, 2].astype(np.float64)
    assert np.abs(steps - np.rint(steps)).max() < 1e-3
    depths = np.unique(cloud.points[:, 2]).astype(np.float64)
    assert len(depths) < len(cloud.points) / 100, "steps are to be seen"
    middles = (depths[1:] + depths[:-1]) / 2
    if tilt == 0:
        assert np.diff(depths) == pytest.approx(disparity_step(middles, KINECT), rel=0.01)


def test_finer_disparities_give_finer_depths() -> None:
    seen = plate(0, 1.0)
    counts = []
    for steps in (1, 8, 64):
        params = SimulationParams(camera=CAMERA, sensor=SensorParams(disparity_steps=steps))
        cloud = measure(seen.image, seen.solid, seen.view, params, np.random.default_rng(0)).cloud
        counts.append(len(np.unique(cloud.points[:, 2])))
    assert counts[0] * 2 < counts[1] < counts[2] / 2


@pytest.mark.parametrize(("tilt", "returns"), [(60, True), (78.5, True), (81.5, False), (88, False)])
def test_nothing_returns_from_a_surface_seen_at_a_grazing_angle(tilt: float, returns: bool) -> None:
    seen = plate(tilt, 1.0, size=0.1)
    lid = 5  # of a box
    assert lid in measure(seen.image, seen.solid, seen.view, NOISELESS, np.random.default_rng(0)).faces
    faces = measure(seen.image, seen.solid, seen.view, KINECT, np.random.default_rng(0)).faces
    assert (lid in faces) == returns


def test_the_rim_of_a_ball_does_not_return() -> None:
    clean, noisy = (see(ball(0.1), look(0, 30, 1.0), noise).cloud for noise in ("none", "kinect"))
    # Beyond 80 degrees lies 1 - sin(80)^2, 3 %, of the disc.
    assert len(noisy.points) / len(clean.points) == pytest.approx(np.sin(np.radians(80)) ** 2, abs=0.01)


def test_edges_are_blurred_by_the_published_fraction_of_a_pixel() -> None:
    seen = plate(0, 1.0, size=0.3)
    rows, columns = np.nonzero(seen.image.labels >= 0)
    middle = slice(rows.min() + 10, rows.max() - 9)
    returned = np.zeros((40, *seen.image.labels.shape))
    for seed, picture in enumerate(returned):
        cloud = measure(seen.image, seen.solid, seen.view, KINECT, np.random.default_rng(seed)).cloud
        picture[pixels_of(cloud)] = 1
    reach = np.arange(-6, 6)
    right = returned[:, middle, columns.max() + 1 + reach].mean(axis=(0, 1))
    left = returned[:, middle, columns.min() - 1 - reach].mean(axis=(0, 1))
    assert right == pytest.approx(left, abs=0.03)
    # How often a pixel k beyond the edge returns is how often a displacement exceeds k: its steps are a distribution.
    share = -np.diff((left + right) / 2)
    assert share.sum() == pytest.approx(1, abs=0.01)
    place = reach[1:] - 0.5
    mean = share @ place
    assert np.sqrt(share @ (place - mean) ** 2) == pytest.approx(0.8, rel=0.15)
    assert abs(mean + 0.5) < 0.05, "edges stay where they are on average"


def test_borders_of_prototypes_are_blurred_and_their_labels_go_with_the_depths() -> None:
    solid = stack((box(0.3, 0.3, 0.02), (0, 0, 0)), (box(0.1, 0.1, 0.02), (0, 0, 0.2)))  # one far before the other
    view = look(0, 90, 1.2)
    image = render(solid, view, CAMERA, 1e-4)
    seen = measure(image, solid, view, KINECT, np.random.default_rng(0))
    rows, columns = pixels_of(seen.cloud)
    crossed = (image.labels[rows, columns] != seen.labels) & (image.labels[rows, columns] >= 0)
    assert 20 < crossed.sum() < 2000
    points = view.to_composition(seen.cloud.points.astype(np.float64))
    for index, height in enumerate((0.01, 0.21)):
        assert np.abs(points[seen.labels == index, 2] - height).max() < 0.02
    assert np.array_equal(seen.labels, seen.faces // 6)


def test_without_noise_every_pixel_that_sees_something_is_an_exact_point() -> None:
    solid, view = stack((box(0.2, 0.1, 0.1), (0, 0, 0)), (ball(0.06), (0, 0.05, 0.06))), look(40, 30, 0.8)
    image = render(solid, view, CAMERA, 1e-5)
    seen = measure(image, solid, view, NOISELESS, np.random.default_rng(0))
    rows, columns = pixels_of(seen.cloud)
    assert len(set(zip(rows, columns, strict=True))) == len(rows) == (image.labels >= 0).sum()
    assert seen.cloud.points[:, 2] == pytest.approx(image.depth[rows, columns], rel=1e-6)
    assert np.array_equal(seen.labels, image.labels[rows, columns])


@pytest.mark.parametrize("noise", ["none", "kinect"])
def test_one_seed_gives_the_same_bits_and_only_noise_asks_for_one(noise: str) -> None:
    first, again, other = (see(ball(0.1), look(0, 0, 1.0), noise, seed).cloud.points for seed in (0, 0, 1))
    assert np.array_equal(first, again)
    assert np.array_equal(first, other) == (noise == "none")


@pytest.mark.parametrize("params", [KINECT, NOISELESS])
def test_an_empty_picture_is_an_empty_cloud(params: SimulationParams) -> None:
    shape = (CAMERA.height, CAMERA.width)
    nothing = DepthImage(np.zeros(shape), np.full(shape, -1))
    seen = measure(nothing, ball(0.1), look(0, 0, 1.0), params, np.random.default_rng(0))
    assert seen.cloud.points.shape == (0, 3)
    assert len(seen.labels) == len(seen.faces) == 0
