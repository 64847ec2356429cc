"""The border of an image, and who reaches it."""

from __future__ import annotations

import numpy as np
import pytest

from service.engine.cloud import PointCloud
from service.tabletop.image import Image


def image_of(measured: np.ndarray) -> Image:
    height, width = measured.shape
    cloud = PointCloud(np.zeros((int(measured.sum()), 3), np.float32), None if measured.all() else measured.ravel())
    image = Image.of(cloud, width)
    assert image is not None
    assert (image.width, image.height) == (width, height)
    return image


def at_border(image: Image, column: int, row: int) -> bool:
    return image.at_border(np.flatnonzero((image.columns == column) & (image.rows == row)))


def test_the_outermost_pixels_are_the_border() -> None:
    image = image_of(np.ones((48, 64), bool))
    for column, row in ((0, 20), (63, 20), (20, 0), (20, 47), (2, 20)):
        assert at_border(image, column, row)
    assert not at_border(image, 20, 20)


def test_a_strip_in_which_nothing_is_measured_moves_the_border_and_a_wide_one_removes_it() -> None:
    measured = np.ones((480, 640), bool)
    measured[:, 630:] = False
    assert at_border(image_of(measured), 629, 100)
    measured[:, 300:] = False
    assert not at_border(image_of(measured), 299, 100)
    assert at_border(image_of(measured), 0, 100)


@pytest.mark.parametrize("width", [None, 0, 7, 100])
def test_a_cloud_that_is_not_in_rows_is_no_image(width: int | None) -> None:
    assert Image.of(PointCloud(np.zeros((100, 3), np.float32)), width) is None
