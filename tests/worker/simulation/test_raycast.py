from __future__ import annotations

import numpy as np
import pytest

from tests.shapes import CAMERA, ball, box, look, stack
from worker.simulation.camera import rays
from worker.simulation.raycast import render


@pytest.mark.parametrize("distance", [0.6, 1.4])
def test_a_ball_is_as_far_as_its_equation_says(distance: float) -> None:
    radius = 0.1
    image = render(ball(radius), look(30, 20, distance), CAMERA, 1e-6)
    # |t r - c|^2 = radius^2 for the ray t r with z = 1, so t is the depth.
    directions = rays(CAMERA)
    square = np.einsum("hwk,hwk->hw", directions, directions)
    discriminant = distance**2 - square * (distance**2 - radius**2)
    seen = discriminant > 0
    depth = (distance - np.sqrt(np.where(seen, discriminant, 0))) / square
    assert ((image.labels >= 0) == seen).mean() > 0.9999
    well_inside = discriminant > 1e-4 * distance**2
    assert well_inside.sum() > 1000
    assert np.abs(image.depth - depth)[well_inside].max() < 2e-5


def test_a_plate_seen_from_the_front_has_one_depth() -> None:
    image = render(box(0.3, 0.2, 0.02), look(0, 90, 1.0), CAMERA, 1e-4)
    assert image.depth[image.labels == 0] == pytest.approx(0.99, abs=1e-6)
    rows, columns = np.nonzero(image.labels == 0)
    width, height = np.ptp(columns) + 1, np.ptp(rows) + 1
    assert sorted([width, height]) == pytest.approx([0.2 * 525 / 0.99, 0.3 * 525 / 0.99], abs=1)


def test_the_nearest_prototype_is_seen_and_nothing_where_nothing_is() -> None:
    solid = stack((ball(0.1), (0, 0, 0)), (ball(0.03), (0, 0, 0.2)))
    image = render(solid, look(0, 90, 1.0), CAMERA, 1e-4)
    height, width = image.labels.shape
    assert image.labels[height // 2, width // 2] == 1
    assert set(np.unique(image.labels)) == {-1, 0, 1}
    assert np.array_equal(image.depth > 0, image.labels >= 0)
    assert (image.depth[image.labels == -1] == 0).all()
