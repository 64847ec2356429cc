"""Point clouds: what the engine takes, and how it is made independent of order, place, attitude and size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class PointCloud:
    """What a sensor measured of one object, in the sensor's frame.

    Attributes:
        points: (N, 3) float32, metres, finite; the sensor at the origin, x right, y down, z forward.
    """

    points: NDArray[np.float32]
