"""Novelty: how unlike everything learned an object is, measured by how unlike each other the training objects are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.engine.divergence import Distributions, jsd_matrix
from service.engine.motifs import Constellations


@dataclass(frozen=True)
class NoveltyScale:
    """What novelty is measured by.

    Attributes:
        wholes: (N,) int64: the motif prototype that is the whole of each training object.
        divergences: (N,) float32, ascending: for each training object the JSD of its whole from that of the training
            object most like it, nats.
    """

    wholes: NDArray[np.int64]
    divergences: NDArray[np.float32]

    def novelty(self, divergence: float) -> float:
        """How novel an object is, [0, 1]: the share of the training objects that are less apart from all others.

        0.95 says: farther from everything learned than 95 % of the training objects are from one another. Objects
        like those learned are as likely to have one novelty as another. Of training objects that are all equally far
        apart, an object is either nearer than that, 0, or farther, 1.

        Args:
            divergence: the JSD of the object's whole from that of the training object most like it, nats.
        """
        return float(np.searchsorted(self.divergences, np.float32(divergence), side="left") / len(self.divergences))


def whole_of(constellations: Constellations) -> int:
    """The constellation that is the whole object: the one of all segments."""
    return int(np.argmax(constellations.members.all(axis=1)))


def divergences_from(whole: NDArray[np.float32], wholes: Distributions) -> NDArray[np.float32]:
    """The JSD of an object's whole (D,) from that of each training object (N,), nats.

    Wholes tell what is novel: the parts of a wire cage or of a table full of things resemble learned ones well enough,
    and stimuli, normalised as they are compared, forget how weak they were.
    """
    return jsd_matrix(whole[None], wholes)[0]
