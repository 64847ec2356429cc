"""What a model keeps of its training objects, so that a concept can be shown without their clouds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Prototypes:
    """The N training objects, each a prototype of a concept or of none.

    Attributes:
        cloud_keys: what each cloud was called: a file's name, or its place in a simulation.
        cloud_hashes: SHA-256 of each cloud's points, in hexadecimal.
        thumbnails: (N, 48, 48) uint8: the object as the sensor saw it, shaded; 0 is background.
        map: (N, 2) float32: places of the objects' responses in the map CR^2.
    """

    cloud_keys: tuple[str, ...]
    cloud_hashes: tuple[str, ...]
    thumbnails: NDArray[np.uint8]
    map: NDArray[np.float32]
