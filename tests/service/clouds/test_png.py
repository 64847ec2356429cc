"""Pictures, as another program reads them."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from service.clouds import png


@pytest.mark.parametrize("shape", [(1, 1), (48, 48), (3, 70), (70, 3)])
def test_a_picture_is_read_as_it_was(shape: tuple[int, int]) -> None:
    image = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)
    picture = Image.open(io.BytesIO(png.write(image)))
    picture.verify()
    read = Image.open(io.BytesIO(png.write(image)))
    assert (read.format, read.mode) == ("PNG", "L")
    assert np.array_equal(np.asarray(read), image)
