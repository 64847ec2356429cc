"""Which points of a cloud that is an image lie at its border."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.engine.cloud import PointCloud

MARGIN = 0.05  # of the image's side: depth cameras measure nothing in a strip of less than this along some borders
NEAR = 2  # pixels from where measurements begin


@dataclass(frozen=True)
class Image:
    """The pixels of a cloud's points.

    Attributes:
        columns: (N,) int64, of each point.
        rows: (N,) int64, of each point.
        width: pixels in a row.
        height: rows.
    """

    columns: NDArray[np.int64]
    rows: NDArray[np.int64]
    width: int
    height: int

    @classmethod
    def of(cls, cloud: PointCloud, width: int | None) -> Image | None:
        """The image that a cloud is; None if it is none: not in rows of the same width, or in one row alone."""
        size = len(cloud.points) if cloud.measured is None else len(cloud.measured)
        if not width or width == size or size % width:
            return None
        pixels = np.arange(size) if cloud.measured is None else np.flatnonzero(cloud.measured)
        return cls(pixels % width, pixels // width, width, size // width)

    def at_border(self, indices: NDArray[np.int64]) -> bool:
        """Whether some of the points reach the border of what is measured, where that is the border of the image."""
        return _reaches(self.columns, self.columns[indices], self.width) or _reaches(
            self.rows, self.rows[indices], self.height
        )


def _reaches(every: NDArray[np.int64], own: NDArray[np.int64], side: int) -> bool:
    low, high = int(every.min()), int(every.max())
    at_low = low < MARGIN * side and own.min() <= low + NEAR
    return bool(at_low or (side - 1 - high < MARGIN * side and own.max() >= high - NEAR))
