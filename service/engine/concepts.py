"""Concepts at any filtration time, and an object's responses to them.

Sec. Extraction of Persistent Shape Concepts, and Sec. Shape Concept Inference, Eq. 4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from service.engine.errors import InvalidParameter
from service.engine.filtration import Filtration
from service.engine.params import ResponseParams
from service.engine.stimuli import Stimuli


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


@dataclass(frozen=True)
class Metric:
    """The Mahalanobis distance between stimuli vectors, as a linear embedding in which it is Euclidean.

    d^2(a, b) = |(f(a) - f(b)) W|^2 + |r(a) - r(b)|^2 / v, where f (takes, if asked, the square root of the vector
    normalised to sum 1, and) weighs each dimension, and r is what of f lies outside the subspace.

    Attributes:
        weights: (V,) float32: of each dimension, after the square root.
        mean: (V,) float32.
        components: (k, V) float32: orthonormal.
        variance: (k,) float64: along each component.
        residual_variance: v, outside the components; infinite where only the subspace counts.
        hellinger: whether square roots of vectors normalised to sum 1 are compared.
    """

    weights: NDArray[np.float32]
    mean: NDArray[np.float32]
    components: NDArray[np.float32]
    variance: NDArray[np.float64]
    residual_variance: float
    hellinger: bool

    def embed(self, stimuli: csr_array) -> NDArray[np.float64]:
        """Coordinates of stimuli vectors (n, V), in units of standard deviations; (n, k)."""
        centred_mean = self.components.astype(np.float64) @ self.mean
        coordinates = self.features(stimuli) @ self.components.T.astype(np.float64) - centred_mean
        return np.asarray(coordinates / np.sqrt(self.variance))

    def residual(self, stimuli: csr_array) -> NDArray[np.float64]:
        """Squared distance from the subspace (n,), over its variance."""
        if not np.isfinite(self.residual_variance):
            return np.zeros(stimuli.shape[0])
        centred = self.features(stimuli).toarray() - self.mean
        inside = centred @ self.components.T.astype(np.float64)
        outside = (centred**2).sum(axis=1) - (inside**2).sum(axis=1)
        return np.asarray(np.maximum(outside, 0) / self.residual_variance)

    def features(self, stimuli: csr_array) -> csr_array:
        """The compared form of each row, sparse float64; a vector of zeros stays one."""
        return features(stimuli, self.weights, self.hellinger)


def features(stimuli: csr_array, weights: NDArray[np.float32], hellinger: bool) -> csr_array:
    """Weighted stimuli vectors (n, V), or weighted square roots of those normalised to sum 1."""
    rows = csr_array(stimuli.astype(np.float64))
    if hellinger:
        total = np.asarray(rows.sum(axis=1)).ravel()
        scale = np.repeat(np.where(total > 0, total, 1.0), np.diff(rows.indptr))
        rows = csr_array((np.sqrt(rows.data / scale), rows.indices, rows.indptr), shape=rows.shape)
    return csr_array(rows.multiply(weights[None, :]))


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


def respond_to_concepts(
    stimuli: Stimuli,
    concepts: Concepts,
    metric: Metric,
    prototypes: NDArray[np.float64],
    params: ResponseParams,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """An object's responses to all concepts.

    Args:
        stimuli: of the object.
        concepts: C of them, over N prototypes.
        metric: between stimuli vectors.
        prototypes: (N, k): the embedded stimuli of the training objects.
        params: which form is scored.

    Returns:
        The form that is scored (C,), and the mean Mahalanobis distance to each concept's prototypes, Eq. 4 (C,); of
        both, smaller is closer.
    """
    row = csr_array((stimuli.values, stimuli.indices, [0, len(stimuli.indices)]), shape=(1, len(metric.weights)))
    squared = ((prototypes - metric.embed(row)) ** 2).sum(axis=1) + metric.residual(row)
    distances = _mean_over_concepts(np.sqrt(squared), concepts)
    if params.score == "distance":
        return distances, distances
    mean_squared = _mean_over_concepts(squared, concepts)
    return mean_squared - (mean_squared.mean() if len(mean_squared) else 0.0), distances


def _mean_over_concepts(values: NDArray[np.float64], concepts: Concepts) -> NDArray[np.float64]:
    member = concepts.assignment >= 0
    total = np.bincount(concepts.assignment[member], values[member], minlength=len(concepts.sizes))
    return total / concepts.sizes
