"""Learning what novelty is measured by: how unlike each other the training objects are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from service.engine.divergence import distributions, jsd_matrix
from service.engine.motifs import Ensemble
from service.engine.novelty import NoveltyScale, whole_of
from worker.learning.observations import Observation

ROWS = 256  # objects compared with all at a time: bounds the memory


def learn_novelty(objects: Sequence[Observation], ensemble: Ensemble) -> NoveltyScale:
    """Leaves each of the N training objects out in turn, and measures how far it is from the nearest of the others.

    Args:
        objects: N of them, at least 2.
        ensemble: grown from them; its prototypes are, object after object, their constellations, or the whole alone.
    """
    sizes = np.bincount(ensemble.objects, minlength=len(objects))
    places = [
        whole_of(o.constellations) if size == len(o.descriptors) else 0
        for o, size in zip(objects, sizes.tolist(), strict=True)
    ]
    wholes = np.cumsum(sizes) - sizes + np.array(places, dtype=np.int64)
    others = distributions(ensemble.prototypes[wholes])
    nearest = np.empty(len(objects), np.float32)
    for start in range(0, len(objects), ROWS):
        own = np.arange(start, min(start + ROWS, len(objects)))
        divergence = jsd_matrix(others.rows[own], others)
        divergence[own - start, own] = np.inf
        nearest[own] = divergence.min(axis=1)
    return NoveltyScale(wholes, np.sort(nearest))
