"""Angles without calls, so that loops over them run on vectors."""

from __future__ import annotations

import numpy as np
from numba import njit

ERROR = 4e-11  # radians, at most: of a polynomial through Chebyshev nodes of arctan(t) / t in t^2, on [0, 1]


@njit(nogil=True, error_model="numpy", inline="always")
def turn(y: float, x: float) -> float:
    """arctan2(y, x), to `ERROR`; 0 at the origin."""
    across, along = abs(y), abs(x)
    steep = across > along
    t = (along if steep else across) / max(along if along > across else across, 1e-300)
    u = t * t
    p = -0.0006633953889916564
    p = p * u + 0.004732483811232622
    p = p * u - 0.015828321820626018
    p = p * u + 0.033826217671905134
    p = p * u - 0.053956679465259026
    p = p * u + 0.07228278283176337
    p = p * u - 0.08974171935393488
    p = p * u + 0.11091922958203586
    p = p * u - 0.1428381325493796
    p = p * u + 0.19999901102105902
    p = p * u - 0.333333312908877
    p = p * u + 0.9999999999293036
    angle = t * p
    angle = np.pi / 2 - angle if steep else angle
    angle = np.pi - angle if x < 0 else angle
    return -angle if y < 0 else angle
