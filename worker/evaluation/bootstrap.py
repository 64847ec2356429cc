"""Intervals of mean recalls, and of differences between them, by drawing groups anew.

Clouds of one group (a scene, an object) are no independent witnesses, so the groups are drawn, not the clouds: Efron,
"Bootstrap Methods: Another Look at the Jackknife", Annals of Statistics 1979, on clusters.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

RESAMPLES = 1_000
LEVEL = 0.95
SEED = 0

DESCRIPTION = (
    f"{LEVEL:.0%} bootstrap intervals: the groups are drawn anew {RESAMPLES:,} times, as many as there are, with "
    "replacement; a label of which no group is drawn is left out of that mean; differences are of the same draws"
)


class Estimate(NamedTuple):
    """A figure and the ends of its interval."""

    value: float
    low: float
    high: float


def mean_recall(labels: NDArray[np.str_], groups: NDArray[np.str_], predicted: NDArray[np.str_]) -> Estimate:
    """The mean recall over labels, with its interval.

    Args:
        labels: (n,) true ones.
        groups: (n,) of the same clouds.
        predicted: (n,), or (R, n) of several repetitions, over which recalls are means.
    """
    return _estimate(_mean_recalls(_weights(groups), labels, groups, predicted))


def difference(
    labels: NDArray[np.str_], groups: NDArray[np.str_], first: NDArray[np.str_], second: NDArray[np.str_]
) -> Estimate:
    """How much higher the first predictions' mean recall is than the second's, with the interval of the difference.

    Args:
        labels: (n,) true ones.
        groups: (n,) of the same clouds.
        first: (n,) or (R, n) labels predicted for the same clouds.
        second: (n,) or (Q, n) others.
    """
    weights = _weights(groups)
    figures = [_mean_recalls(weights, labels, groups, predicted) for predicted in (first, second)]
    return _estimate(figures[0] - figures[1])


def _weights(groups: NDArray[np.str_]) -> NDArray[np.float64]:
    """How often each group counts (1 + resamples, G): once each in the first row, as drawn in the others."""
    count = len(np.unique(groups))
    drawn = np.random.default_rng(SEED).multinomial(count, np.full(count, 1 / count), size=RESAMPLES)
    return np.vstack([np.ones(count), drawn])


def _mean_recalls(
    weights: NDArray[np.float64], labels: NDArray[np.str_], groups: NDArray[np.str_], predicted: NDArray[np.str_]
) -> NDArray[np.float64]:
    """The mean recall over labels under each row of weights."""
    right = np.atleast_2d(predicted == labels).mean(axis=0)  # (n,) the share of the repetitions
    known, place = np.unique(groups, return_inverse=True)
    categories, label = np.unique(labels, return_inverse=True)
    clouds, hits = np.zeros((2, len(known), len(categories)))
    np.add.at(clouds, (place, label), 1.0)
    np.add.at(hits, (place, label), right)
    asked = weights @ clouds  # (1 + resamples, K)
    recall = np.divide(weights @ hits, asked, out=np.zeros_like(asked), where=asked > 0)
    return np.asarray(recall.sum(axis=1) / (asked > 0).sum(axis=1))


def _estimate(figures: NDArray[np.float64]) -> Estimate:
    low, high = np.quantile(figures[1:], [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return Estimate(float(figures[0]), float(low), float(high))
