"""Stimuli: how strongly an object's constellations excite the motif vertices (Sec. Stimuli Generation, Eq. 1)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from service.engine.divergence import jsd_matrix
from service.engine.motifs import Constellations, Ensemble
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
    """

    alpha: NDArray[np.float64]
    active: NDArray[np.bool_] | None


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
    return accumulate(excite(ensemble, constellations, descriptors, words, params), params)


def excite(
    ensemble: Ensemble,
    constellations: Constellations,
    descriptors: NDArray[np.float32],
    words: NDArray[np.int64],
    params: StimuliParams,
) -> Excitation:
    """What each constellation gives each vertex, before it is pooled; the arguments are those of `stimulate`."""
    kernel = gaussian_of_jsd(descriptors, ensemble.prototypes, params.sigma)
    alpha = kernel @ ensemble.mean_over_vertex  # (C, V): the mean over T^v of each constellation's kernel values
    alpha *= (constellations.coverage**params.coverage_power)[:, None]
    active = _activated(ensemble, constellations, words, params)
    return Excitation(alpha if active is None else np.where(active, alpha, 0.0), active)


def accumulate(excitation: Excitation, params: StimuliParams) -> Stimuli:
    """The stimuli vector: one stimulus a vertex, of those of all constellations that activate it."""
    gamma = _pool(excitation, params.pooling).astype(np.float32)
    index = np.flatnonzero(gamma > params.cutoff).astype(np.int32)
    return Stimuli(index, gamma[index])


def gaussian_of_jsd(queries: NDArray[np.float32], prototypes: NDArray[np.float32], sigma: float) -> NDArray[np.float64]:
    """exp(-JSD^2 / (2 sigma^2)) of every query with every prototype, (C, P); the JSD to about 1e-6 nats."""
    return np.exp(-(jsd_matrix(queries, prototypes).astype(np.float64) ** 2) / (2 * sigma**2))


def _activated(
    ensemble: Ensemble, constellations: Constellations, words: NDArray[np.int64], params: StimuliParams
) -> NDArray[np.bool_] | None:
    """Which constellation activates which vertex (C, V); None where all do."""
    if params.gating == "kernel":
        return None
    active = np.zeros((len(constellations.members), ensemble.vertex_count), dtype=bool)
    first = 0
    for hierarchy, column in zip(ensemble.hierarchies, words.T, strict=True):
        for (_, c), motif in zip(constellations.levels, constellations.motifs(column), strict=True):
            vertex = hierarchy.index.get(motif)
            if vertex is not None:
                active[c, first + vertex] = True
        first += len(hierarchy.vertices)
    return active


def _pool(excitation: Excitation, pooling: str) -> NDArray[np.float64]:
    alpha, active = excitation
    if pooling == "max":
        return alpha.max(axis=0)
    total = alpha.sum(axis=0)
    if pooling == "sum":
        return total
    return total / (len(alpha) if active is None else np.maximum(active.sum(axis=0), 1))
