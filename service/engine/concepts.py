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
from service.engine.metric import Metric
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
class Spectrum:
    """The concepts that an object is compared with, of one filtration time or of several.

    Attributes:
        concepts: those of the time asked for, epsilon_max for none; they are the first C of all K.
        ids: (K,) int64: nodes in the merge tree, each once.
        sizes: (K,) int64: numbers of prototypes.
        times: (K,) float64: the filtration time at which each was taken: of the first C the time asked for, of the
            others the earliest.
        membership: (K, N) float64 sparse: one over the concept's size where a prototype belongs to it.
    """

    concepts: Concepts
    ids: NDArray[np.int64]
    sizes: NDArray[np.int64]
    times: NDArray[np.float64]
    membership: csr_array

    def members(self, concept: int) -> NDArray[np.int64]:
        """The prototypes of one concept, ascending."""
        first, end = self.membership.indptr[concept : concept + 2]
        return np.sort(self.membership.indices[first:end]).astype(np.int64)


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


def is_concept(filtration: Filtration, node: int) -> bool:
    """Whether a node of the merge tree is a concept at some filtration time.

    Of annexations at the same time, only the last one of each component makes a concept.
    """
    size = len(filtration.time) + 1
    time = filtration.time[filtration.order == node - size]
    return len(time) == 1 and node in concepts_at(filtration, float(time[0])).ids


def spectrum_at(filtration: Filtration, time: float | None, scales: int) -> Spectrum:
    """The concepts to compare an object with.

    Args:
        filtration: of N prototypes.
        time: in [0, 1]: the concepts of that time alone. None: those at epsilon_max, and after them the specific and
            the generic ones, which the filtration has at other times only, in the order of these times.
        scales: n of the other times 1/n to (n-1)/n.

    Raises:
        InvalidParameter: the time is not in [0, 1].
    """
    own = concepts_at(filtration, time)
    others = [concepts_at(filtration, step / scales) for step in range(1, scales)] if time is None else []
    seen: dict[int, tuple[float, NDArray[np.int64]]] = {}
    for concepts in (own, *others):
        order = np.argsort(concepts.assignment, kind="stable")
        members = np.split(order[len(order) - concepts.sizes.sum() :], np.cumsum(concepts.sizes)[:-1])
        for node, prototypes in zip(concepts.ids.tolist(), members, strict=False):
            seen.setdefault(node, (concepts.time, prototypes))
    sizes = np.array([len(prototypes) for _, prototypes in seen.values()], np.int64)
    columns = np.concatenate([prototypes for _, prototypes in seen.values()] or [np.zeros(0, np.int64)])
    shape = (len(sizes), len(own.assignment))
    membership = csr_array((np.repeat(1.0 / sizes, sizes), columns, np.cumsum([0, *sizes])), shape=shape)
    times = np.array([moment for moment, _ in seen.values()])
    return Spectrum(own, np.array(list(seen), np.int64), sizes, times, membership)


def spread_of(spectrum: Spectrum, prototypes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean squared distance of each concept's prototypes from their mean (K,).

    Args:
        spectrum: K concepts over N prototypes.
        prototypes: (N, k): the embedded stimuli of the training objects.
    """
    squared = spectrum.membership @ (prototypes**2).sum(axis=1)
    return np.asarray(squared - ((spectrum.membership @ prototypes) ** 2).sum(axis=1))


def respond_to_concepts(
    squared: NDArray[np.float64], spectrum: Spectrum, spread: NDArray[np.float64], params: ResponseParams
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """An object's responses to all concepts.

    The score "discriminant" has the form of linear discriminant analysis, with the covariance of all objects in place
    of that within concepts: the squared distance to the mean of a concept's prototypes less twice the logarithm of its
    size, which is how likely an object is one of its kind beforehand. The former is the mean squared distance to the
    prototypes less their own spread, so that tight concepts do not rank before wide ones. What an object has of all
    concepts alike, being far from everything, is taken off too.

    Args:
        squared: (N,) squared Mahalanobis distances of the object from the concept prototypes.
        spectrum: K concepts over N prototypes.
        spread: (K,) of the concepts.
        params: which form is scored.

    Returns:
        The form that is scored (K,), and the mean Mahalanobis distance to each concept's prototypes, Eq. 4 (K,); of
        both, smaller is closer.
    """
    distances = np.asarray(spectrum.membership @ np.sqrt(squared))
    if params.score == "distance" or len(distances) == 0:
        return distances, distances
    discriminants = spectrum.membership @ squared - spread - 2 * np.log(spectrum.sizes)
    return discriminants - discriminants.mean(), distances


def rank_concepts(responses: NDArray[np.float64], spectrum: Spectrum) -> NDArray[np.int64]:
    """Places of the concepts (K,): those of the time asked for, closest first, then all others, closest first.

    Of equal ones the first. Concepts of one time share no prototype: the first is one of several that exclude each
    other, and a specific concept within it, or a generic one around it, comes later.
    """
    other = np.arange(len(responses)) >= len(spectrum.concepts.sizes)
    return np.lexsort((responses, other))


def squared_distances(stimuli: Stimuli, metric: Metric, prototypes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Squared Mahalanobis distances of an object from all training objects (N,)."""
    away = prototypes - metric.embed_one(*stimuli)
    within = np.einsum("nk,nk->n", away, away)
    if not np.isfinite(metric.residual_variance):
        return np.asarray(within)
    row = csr_array((stimuli.values, stimuli.indices, [0, len(stimuli.indices)]), shape=(1, len(metric.weights)))
    return np.asarray(within + metric.residual(row))
