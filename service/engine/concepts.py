"""Concepts at any filtration time, and an object's responses to them.

Sec. Extraction of Persistent Shape Concepts, and Sec. Shape Concept Inference, Eq. 4.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from service.engine.errors import InvalidParameter
from service.engine.filtration import Filtration
from service.engine.metric import Metric
from service.engine.params import ResponseParams
from service.engine.stimuli import Stimuli

NEGLIGIBLE = 1e-9  # deviations of less than this share of the largest squared distance are rounding


@dataclass(frozen=True)
class Concepts:
    """The concepts at one filtration time: components of F of at least two prototypes.

    Attributes:
        time: the filtration time, [0, 1].
        ids: (C,) int64: the concept's node in the merge tree: N + the place of its last annexation. A concept keeps
            it at every time at which it exists.
        sizes: (C,) int64: number of prototypes; largest first, of equal ones the one with the first prototype.
        assignment: (N,) int64: the place of each prototype's concept, -1 for none.
    """

    time: float
    ids: NDArray[np.int64]
    sizes: NDArray[np.int64]
    assignment: NDArray[np.int64]


class Baseline(NamedTuple):
    """The relative responses of the training objects to each concept: what is usual.

    Attributes:
        mean: (C,) float64; deviation: (C,) float64, 1 where they do not vary.
    """

    mean: NDArray[np.float64]
    deviation: NDArray[np.float64]


def concepts_at(filtration: Filtration, time: float | None = None) -> Concepts:
    """The concepts at a filtration time: F without the edges that are later.

    Args:
        filtration: of N prototypes.
        time: in [0, 1]; None for epsilon_max. Early ones give specific concepts, late ones generic ones.

    Raises:
        InvalidParameter: the time is not in [0, 1].
    """
    moment = filtration.epsilon_max if time is None else float(time)
    if not 0 <= moment <= 1:
        raise InvalidParameter(f"The filtration time is {moment:g}; it runs from 0 (specific) to 1 (one concept).")
    size = len(filtration.time) + 1
    kept = np.flatnonzero(filtration.time <= moment)
    ends = (filtration.annexed[kept], filtration.annexing[kept])
    graph = csr_array((np.ones(len(kept), np.int8), ends), shape=(size, size))
    component = connected_components(graph, directed=False)[1]
    last = np.full(size, -1, np.int64)
    np.maximum.at(last, component[ends[0]], filtration.order[kept])
    _, first, count = np.unique(component, return_index=True, return_counts=True)
    ranked = [c for c in np.lexsort((first, -count)) if count[c] >= 2]
    place = np.full(size, -1, np.int64)
    place[ranked] = np.arange(len(ranked))
    return Concepts(moment, size + last[ranked], count[ranked].astype(np.int64), place[component])


def baseline_of(concepts: Concepts, prototypes: NDArray[np.float64]) -> Baseline:
    """How the training objects themselves respond to the concepts.

    The mean squared distance to a set of points is that to their mean and their spread about it, so no distance
    between two prototypes is needed.

    Args:
        concepts: C of them, over N prototypes.
        prototypes: (N, k): the embedded stimuli of the training objects.
    """
    centre = np.stack([_mean_over_concepts(axis, concepts) for axis in prototypes.T], axis=1)
    norm = (prototypes**2).sum(axis=1)
    squared = norm[:, None] - 2 * prototypes @ centre.T + _mean_over_concepts(norm, concepts)
    relative = squared - squared.mean(axis=1, keepdims=True) if len(centre) else squared
    deviation = relative.std(axis=0)
    varies = deviation > NEGLIGIBLE * squared.max(initial=0.0)
    return Baseline(relative.mean(axis=0), np.where(varies, deviation, 1.0))


def respond_to_concepts(
    stimuli: Stimuli,
    concepts: Concepts,
    metric: Metric,
    prototypes: NDArray[np.float64],
    baseline: Baseline,
    params: ResponseParams,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """An object's responses to all concepts.

    Args:
        stimuli: of the object.
        concepts: C of them, over N prototypes.
        metric: between stimuli vectors.
        prototypes: (N, k): the embedded stimuli of the training objects.
        baseline: of the training objects.
        params: which form is scored.

    Returns:
        The form that is scored (C,), and the mean Mahalanobis distance to each concept's prototypes, Eq. 4 (C,); of
        both, smaller is closer.
    """
    squared = squared_distances(stimuli, metric, prototypes)
    distances = _mean_over_concepts(np.sqrt(squared), concepts)
    if params.score == "distance" or len(distances) == 0:
        return distances, distances
    mean_squared = _mean_over_concepts(squared, concepts)
    relative = mean_squared - mean_squared.mean()
    if params.score == "relative":
        return relative, distances
    return (relative - baseline.mean) / baseline.deviation, distances


def squared_distances(stimuli: Stimuli, metric: Metric, prototypes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Squared Mahalanobis distances of an object from all training objects (N,)."""
    row = csr_array((stimuli.values, stimuli.indices, [0, len(stimuli.indices)]), shape=(1, len(metric.weights)))
    return np.asarray(((prototypes - metric.embed(row)) ** 2).sum(axis=1) + metric.residual(row))


def _mean_over_concepts(values: NDArray[np.float64], concepts: Concepts) -> NDArray[np.float64]:
    member = concepts.assignment >= 0
    total = np.bincount(concepts.assignment[member], values[member], minlength=len(concepts.sizes))
    return total / concepts.sizes
