"""Learning the visual words: divisive hierarchical clustering (Sec. Object Segment Extraction)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from service.engine.dictionary import Dictionary
from service.engine.params import DictionaryParams

ROUNDS = 100  # of Lloyd's algorithm; it ends by itself long before


def learn_dictionary(descriptors: NDArray[np.float32], params: DictionaryParams) -> Dictionary:
    """Splits all segments in two, each half in two, and so on: level f holds the means of 2^f clusters.

    A cluster that cannot be split hands its mean to both halves, so that level f has 2^f words all the same.

    Args:
        descriptors: (n, D) of all training segments, at least one.
        params: number of levels.
    """
    clusters = [descriptors.astype(np.float64)]
    means = [clusters[0].mean(axis=0)]
    levels = []
    for _ in range(params.levels):
        halves = [half for cluster, mean in zip(clusters, means, strict=True) for half in _split(cluster, mean)]
        clusters = [cluster for cluster, _ in halves]
        means = [mean for _, mean in halves]
        levels.append(np.stack(means).astype(np.float32))
    return Dictionary(tuple(levels))


_Half = tuple[NDArray[np.float64], NDArray[np.float64]]


def _split(cluster: NDArray[np.float64], mean: NDArray[np.float64]) -> list[_Half]:
    """Two halves and their means, by 2-means that starts from the two sides of the principal component."""
    if len(cluster) == 0 or np.ptp(cluster, axis=0).max() == 0:
        return [(cluster, mean), (cluster[:0], mean)]
    side = (cluster - mean) @ principal_direction(cluster - mean) > 0
    for _ in range(ROUNDS):
        if side.all() or not side.any():
            return [(cluster, mean), (cluster[:0], mean)]
        low, high = cluster[~side].mean(axis=0), cluster[side].mean(axis=0)
        closer = ((cluster - high) ** 2).sum(axis=1) < ((cluster - low) ** 2).sum(axis=1)
        if (closer == side).all():
            break
        side = closer
    return [(cluster[~side], low), (cluster[side], high)]


def principal_direction(centred: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit vector (D,) of the largest variance, its largest coordinate positive."""
    direction = np.linalg.eigh(centred.T @ centred)[1][:, -1]
    return direction * np.sign(direction[np.abs(direction).argmax()])
