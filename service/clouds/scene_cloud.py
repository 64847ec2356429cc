"""A cloud with what it takes to tell of places in it as its sender does."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from service.clouds.frame import UNITS, Viewpoint
from service.engine.cloud import PointCloud


class SceneCloud(NamedTuple):
    """A cloud in the sensor's frame, and what it takes to tell of it in its own frame.

    Attributes:
        cloud: what was measured.
        pose: of the sensor in the cloud's own frame and unit.
        unit: of the file's coordinates, one of UNITS.
        width: pixels in a row, where the cloud is an image; None where it is none.
    """

    cloud: PointCloud
    pose: Viewpoint = Viewpoint()
    unit: str = "m"
    width: int | None = None

    def to_own_frame(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """A point (3,) of the sensor's frame in the cloud's own, metres in both."""
        return self.pose.rotation @ point + np.array(self.pose.position) * UNITS[self.unit]
