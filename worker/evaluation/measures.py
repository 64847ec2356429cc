"""Figures for concepts and for predictions, as pure functions. Sec. Unsupervised Concept Selection, Eq. 5 and 6."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

RANK_EPSILON = 1e-3  # the "small constant" of Eq. 6, which the paper leaves open: pure concepts come before all others


def label_counts(assignment: ArrayLike, labels: Sequence[str | None], categories: Sequence[str]) -> NDArray[np.int64]:
    """How many prototypes of each category each concept has.

    Args:
        assignment: (N,) concept of each prototype, -1 for none.
        labels: (N,) of the prototypes; one that is no category is counted nowhere.
        categories: K different ones.

    Returns:
        (C, K); C is one more than the highest concept assigned.
    """
    concept = np.asarray(assignment, dtype=np.int64)
    place = {category: number for number, category in enumerate(categories)}
    counts = np.zeros((concept.max(initial=-1) + 1, len(categories)), np.int64)
    known = [(c, place[label]) for c, label in zip(concept, labels, strict=True) if c >= 0 and label in place]
    for c, category in known:
        counts[c, category] += 1
    return counts


def purity(counts: ArrayLike, sizes: ArrayLike) -> NDArray[np.float64]:
    """pu(c), the largest share of one category among a concept's prototypes, Eq. 5.

    Args:
        counts: (C, K) prototypes of each category.
        sizes: (C,) prototypes of each concept, at least 1.
    """
    return np.asarray(np.asarray(counts).max(axis=1, initial=0) / np.asarray(sizes, dtype=np.float64))


def rank_score(purities: ArrayLike, sizes: ArrayLike, epsilon: float = RANK_EPSILON) -> NDArray[np.float64]:
    """rs(c) = |P^c| / (1 - pu(c) + epsilon), Eq. 6: large for large and pure concepts."""
    return np.asarray(np.asarray(sizes) / (1 - np.asarray(purities, dtype=np.float64) + epsilon))


def pure_share(purities: ArrayLike) -> float:
    """Share of the concepts that hold prototypes of a single category; at least one concept."""
    return float(np.mean(np.asarray(purities) == 1))


def recalls(labels: NDArray[np.str_], predicted: NDArray[np.str_]) -> dict[str, float]:
    """Of each label, the share of its instances that were predicted right."""
    return {str(label): float(np.mean(predicted[labels == label] == label)) for label in np.unique(labels)}


def balanced_accuracy(labels: NDArray[np.str_], predicted: NDArray[np.str_]) -> float:
    """Mean of the recalls: every label counts as much, however many instances it has."""
    return float(np.mean(list(recalls(labels, predicted).values())))
