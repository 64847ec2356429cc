"""Stimuli: how strongly an object's constellations excite the motif vertices (Sec. Stimuli Generation, Eq. 1)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from service.engine.divergence import Distributions, jsd_matrix
from service.engine.motifs import Constellations, Ensemble, Rank
from service.engine.params import StimuliParams


class Stimuli(NamedTuple):
    """A sparse stimuli vector *gamma^o over all vertices of all hierarchies.

    Attributes:
        indices: (K,) int32, ascending: the vertices that are excited, counted through H_1 to H_n.
        values: (K,) float32, positive.
    """

    indices: NDArray[np.int32]
    values: NDArray[np.float32]


class Excitation(NamedTuple):
    """What each constellation of an object alone excites.

    Attributes:
        alpha: (C, V) float64: the stimulus that each constellation gives each vertex, 0 where it does not activate it.
        active: (C, V) bool: which constellation activates which vertex: the indicator of Eq. 1; None where all do.
        weights: (C,) float64: of the constellations, by what they cover; part of `alpha`.
    """

    alpha: NDArray[np.float64]
    active: NDArray[np.bool_] | None
    weights: NDArray[np.float64]


def stimulate(
    ensemble: Ensemble,
    constellations: Constellations,
    descriptors: NDArray[np.float32],
    words: NDArray[np.int64],
    params: StimuliParams,
) -> Stimuli:
    """The stimuli vector of an object (Eq. 1); the ensemble is never modified.

    Args:
        ensemble: HE.
        constellations: of the object, C of them.
        descriptors: (C, D) of the constellations.
        words: (S, n) of the segments.
        params: bandwidth, gating and pooling.
    """
    if params.gating == "rank" and params.pooling == "mean" and params.balanced:
        return _sparse(_mean_by_rank(ensemble, constellations, descriptors, params), params)
    return accumulate(excite(ensemble, constellations, descriptors, words, params), ensemble, params)


def excite(
    ensemble: Ensemble,
    constellations: Constellations,
    descriptors: NDArray[np.float32],
    words: NDArray[np.int64],
    params: StimuliParams,
) -> Excitation:
    """What each constellation gives each vertex, before it is pooled; the arguments are those of `stimulate`.

    Where constellations are told by their rank, ranks that weigh nothing are spared, and are given 0.
    """
    weights = constellations.coverage**params.coverage_power
    active = _activated(ensemble, constellations, words, params)
    if params.gating == "rank":
        alpha = _excite_by_rank(ensemble, constellations, descriptors, params)
    else:
        alpha = gaussian_of_jsd(descriptors, ensemble.distributions, params.sigma) @ ensemble.mean_over_vertex
        if active is not None:
            alpha[~active] = 0.0
    return Excitation(alpha * weights[:, None], active, weights)


def accumulate(excitation: Excitation, ensemble: Ensemble, params: StimuliParams) -> Stimuli:
    """The stimuli vector: one stimulus a vertex, of those of all constellations that activate it.

    Where motif levels are balanced, the stimuli of each rank, single segments, unions and wholes, are scaled to sum to
    the rank's weight times the number of all vertices: as much in every object, whatever it resembles. A rank that an
    object has no constellation of stays 0.
    """
    pooled = _pool(excitation, params.pooling)
    return _sparse(_balance(pooled, ensemble, params) if params.balanced else pooled, params)


def _sparse(gamma: NDArray[np.float64], params: StimuliParams) -> Stimuli:
    """The stimuli above the cutoff, of those of all vertices (V,)."""
    rounded = gamma.astype(np.float32)
    index = np.flatnonzero(rounded > params.cutoff).astype(np.int32)
    return Stimuli(index, rounded[index])


def _mean_by_rank(
    ensemble: Ensemble, constellations: Constellations, descriptors: NDArray[np.float32], params: StimuliParams
) -> NDArray[np.float64]:
    """The balanced stimuli of all vertices (V,), where constellations of a rank are pooled by their mean.

    As it is linear, the mean is taken of their kernel values, before these are distributed over the vertices.
    """
    gamma = np.zeros(ensemble.vertex_count)
    coverage = constellations.coverage**params.coverage_power
    of_rank = _of_rank(constellations, ensemble.top_level)
    for rank, weight in _weights(params).items():
        own = np.flatnonzero(of_rank[:, rank])
        memories = ensemble.memories.get(rank)
        if weight == 0 or memories is None or not len(own):
            continue
        kernel = gaussian_of_jsd(descriptors[own], memories.prototypes, params.sigma)
        pooled = memories.means_of_vertices @ (coverage[own] @ kernel)
        total = pooled.sum()
        if total > 0:
            gamma[memories.vertices] = pooled / total * (weight * len(gamma))
    return gamma


def gaussian_of_jsd(queries: NDArray[np.float32], prototypes: Distributions, sigma: float) -> NDArray[np.float64]:
    """exp(-JSD^2 / (2 sigma^2)) of every query with each of P prototypes, (C, P); the JSD to about 1e-6 nats."""
    return np.exp(-(jsd_matrix(queries, prototypes).astype(np.float64) ** 2) / (2 * sigma**2))


def _excite_by_rank(
    ensemble: Ensemble, constellations: Constellations, descriptors: NDArray[np.float32], params: StimuliParams
) -> NDArray[np.float64]:
    """The mean over T^v of each constellation's kernel values (C, V), 0 for vertices of ranks that it is not of."""
    alpha = np.zeros((len(descriptors), ensemble.vertex_count))
    of_rank = _of_rank(constellations, ensemble.top_level)
    weights = _weights(params)
    for rank, memories in ensemble.memories.items():
        if params.balanced and weights[rank] == 0:
            continue
        own = np.flatnonzero(of_rank[:, rank])
        kernel = gaussian_of_jsd(descriptors[own], memories.prototypes, params.sigma)
        alpha[np.ix_(own, memories.vertices)] = kernel @ memories.mean_over_vertex
    return alpha


def _activated(
    ensemble: Ensemble, constellations: Constellations, words: NDArray[np.int64], params: StimuliParams
) -> NDArray[np.bool_] | None:
    """Which constellation activates which vertex (C, V); None where all do."""
    if params.gating == "kernel":
        return None
    if params.gating == "rank":
        return _of_rank(constellations, ensemble.top_level)[:, ensemble.vertex_ranks]
    active = np.zeros((len(constellations.members), ensemble.vertex_count), dtype=bool)
    first = 0
    for hierarchy, column in zip(ensemble.hierarchies, words.T, strict=True):
        for (_, c), motif in zip(constellations.levels, constellations.motifs(column), strict=True):
            vertex = hierarchy.index.get(motif)
            if vertex is not None:
                active[c, first + vertex] = True
        first += len(hierarchy.vertices)
    return active


def _of_rank(constellations: Constellations, top: int) -> NDArray[np.bool_]:
    """Which constellation is of which rank (C, 3), for vertices of the motif levels 1 to `top`.

    Of unions the whole object is the largest one, and that of a single segment its only one: unions tell what parts
    look like together, never how many there are.
    """
    level, c = constellations.levels.T
    of_rank = np.zeros((len(constellations.coverage), 3), dtype=bool)
    of_rank[c[level == 1], Rank.SEGMENT] = True
    of_rank[c[(level > 1) & (level < top)], Rank.UNION] = True
    of_rank[constellations.coverage.argmax(), Rank.UNION] = True
    of_rank[c[level == top], Rank.WHOLE] = True
    return of_rank


def _pool(excitation: Excitation, pooling: str) -> NDArray[np.float64]:
    alpha, active, weights = excitation
    if pooling == "max":
        return alpha.max(axis=0)
    total = alpha.sum(axis=0)
    if pooling == "sum":
        return total
    share = np.full(alpha.shape[1], weights.sum()) if active is None else weights @ active
    return np.asarray(total / np.where(share > 0, share, 1.0))


def _balance(gamma: NDArray[np.float64], ensemble: Ensemble, params: StimuliParams) -> NDArray[np.float64]:
    """Stimuli of which each rank's sum to its weight times V."""
    out = np.zeros_like(gamma)
    for rank, weight in _weights(params).items():
        of_rank = ensemble.vertex_ranks == rank
        total = gamma[of_rank].sum()
        if total > 0:
            out[of_rank] = gamma[of_rank] / total * (weight * len(gamma))
    return out


def _weights(params: StimuliParams) -> dict[Rank, float]:
    """What each rank weighs, where they are balanced."""
    return {
        Rank.SEGMENT: params.segment_weight,
        Rank.UNION: params.union_weight,
        Rank.WHOLE: params.whole_weight,
    }
