"""What a model shows of its training objects."""

from __future__ import annotations

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from tests.learnt import learnt, perceived
from tests.service.engine.seen import seen
from tests.shapes import box, cube, look, stack
from worker.learning.prototypes import draw_map, draw_thumbnail


def test_a_thumbnail_shows_the_object_as_the_sensor_saw_it():
    """A cube's front and top seen from above: the top, which faces the light, is above and brighter."""
    image = draw_thumbnail(seen(cube(0.15), look(0, 35, 0.9)).graph)
    assert image.shape == (48, 48)
    assert image.dtype == np.uint8
    rows = np.flatnonzero(image.any(axis=1))
    upper, lower = image[rows[0] + 4], image[rows[-1] - 4]
    assert np.median(upper[upper > 0]) > np.median(lower[lower > 0]) + 20
    assert not image[:, 0].any()
    assert not image[0].any()


def test_a_thumbnail_turns_with_the_camera():
    upright, on_its_side = (draw_thumbnail(seen(cube(0.15), look(0, 35, 0.9, roll)).graph) for roll in (0, 90))
    rows, columns = (np.flatnonzero((on_its_side > 0).any(axis=axis)) for axis in (1, 0))
    turned = max(np.corrcoef(np.rot90(upright, k).ravel().astype(float), on_its_side.ravel())[0, 1] for k in (1, 3))
    assert turned > 0.9
    assert len(rows) > 20 < len(columns)


def test_left_is_left_up_is_up_and_the_light_comes_from_the_upper_right():
    """A slab with a post on its right end: the camera looks along -x, so that +y is to its right and +z up."""
    post = stack((box(0.1, 0.2, 0.05), (0, 0, 0)), (box(0.1, 0.05, 0.15), (0, 0.075, 0.1)))
    image = draw_thumbnail(seen(post, look(0, 0, 0.9)).graph)
    rows, columns = np.nonzero(image)
    middle = (columns.min() + columns.max()) / 2
    assert (columns[rows < rows.min() + 20] > middle).all()
    assert (columns[rows > rows.max() - 4] < middle).any()
    to_the_left, to_the_right = (draw_thumbnail(seen(cube(0.15), look(a, 0, 0.9)).graph) for a in (25, -25))
    broad_face_to_the_left, broad_face_to_the_right = (
        np.bincount(i[i > 0]).argmax() for i in (to_the_left, to_the_right)
    )
    assert broad_face_to_the_right > broad_face_to_the_left + 20


def test_every_training_object_has_a_thumbnail_of_its_own():
    thumbnails = learnt().prototypes.thumbnails
    assert np.array_equal(thumbnails, np.stack([draw_thumbnail(p.graph) for p in perceived()]))
    assert all(40 < np.count_nonzero(image) < 48 * 48 for image in thumbnails)
    assert len(np.unique(thumbnails, axis=0)) == len(thumbnails)


@pytest.mark.parametrize(("size", "width"), [(1, 1), (2, 1), (3, 2), (4, 1), (5, 7), (40, 7)])
def test_a_map_has_a_place_for_each_object_and_one_seed_draws_one_map(size: int, width: int):
    coordinates = np.random.default_rng(0).standard_normal((size, width))
    with threadpool_limits(1):
        a, b = (draw_map(coordinates, seed=3) for _ in range(2))
    assert a.shape == (size, 2)
    assert a.dtype == np.float32
    assert np.isfinite(a).all()
    assert np.array_equal(a, b)


def test_groups_stay_together_on_the_map():
    rng = np.random.default_rng(0)
    groups = np.repeat([[0.0] * 5, [20.0] * 5, [0, 40, 0, 40, 0]], 20, axis=0)
    with threadpool_limits(1):
        places = draw_map(groups + rng.standard_normal(groups.shape), seed=0)
    label = np.repeat(np.arange(3), 20)
    distance = np.linalg.norm(places[:, None] - places[None], axis=2)
    np.fill_diagonal(distance, np.inf)
    assert (label[distance.argmin(axis=1)] == label).mean() > 0.95
