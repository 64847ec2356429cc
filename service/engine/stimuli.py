"""Stimuli: how strongly an object's constellations excite the motif vertices (Sec. Stimuli Generation, Eq. 1)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from service.engine.motifs import Constellations, Ensemble
from service.engine.params import StimuliParams

LN2 = float(np.log(2.0))


class Stimuli(NamedTuple):
    """A sparse stimuli vector *gamma^o over all vertices of all hierarchies.

    Attributes:
        indices: (K,) int32, ascending: the vertices that are excited, counted through H_1 to H_n.
        values: (K,) float32, positive.
    """

    indices: NDArray[np.int32]
    values: NDArray[np.float32]


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
    kernel = gaussian_of_jsd(descriptors, ensemble.prototypes, params.sigma)
    alpha = kernel @ ensemble.mean_over_vertex  # (C, V): the mean over T^v of each constellation's kernel values
    alpha *= (constellations.coverage**params.coverage_power)[:, None]
    gamma = _pool(alpha, _activated(ensemble, constellations, words, params), params.pooling).astype(np.float32)
    index = np.flatnonzero(gamma > params.cutoff).astype(np.int32)
    return Stimuli(index, gamma[index])


def gaussian_of_jsd(queries: NDArray[np.float32], prototypes: NDArray[np.float32], sigma: float) -> NDArray[np.float64]:
    """exp(-JSD^2 / (2 sigma^2)) of every query with every prototype, (C, P); the JSD to about 1e-6 nats."""
    return np.exp(-(jsd_matrix(queries, prototypes).astype(np.float64) ** 2) / (2 * sigma**2))


def jsd_matrix(queries: NDArray[np.float32], prototypes: NDArray[np.float32]) -> NDArray[np.float32]:
    """Jensen-Shannon divergence in nats, to about 1e-6, of every two rows that each sum to 1; (C, P) float32.

    JSD(p, q) = H((p + q) / 2) - H(p) / 2 - H(q) / 2 = ln 2 + sum [x(p) + x(q) - x(p + q)] / 2 with x(t) = t ln t, so
    that one logarithm a bin is left for each pair.
    """
    queries, prototypes = np.ascontiguousarray(queries), np.ascontiguousarray(prototypes)
    return _jsd_matrix(queries, prototypes, _sum_t_log_t(queries), _sum_t_log_t(prototypes))


def _activated(
    ensemble: Ensemble, constellations: Constellations, words: NDArray[np.int64], params: StimuliParams
) -> NDArray[np.bool_] | None:
    """Which constellation activates which vertex (C, V): the indicator of Eq. 1; None where all do."""
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


def _pool(alpha: NDArray[np.float64], active: NDArray[np.bool_] | None, pooling: str) -> NDArray[np.float64]:
    """One stimulus a vertex, of those of all constellations that activate it; (V,)."""
    if active is not None:
        alpha = np.where(active, alpha, 0.0)
    if pooling == "max":
        return alpha.max(axis=0)
    total = alpha.sum(axis=0)
    if pooling == "sum":
        return total
    return total / (len(alpha) if active is None else np.maximum(active.sum(axis=0), 1))


def _sum_t_log_t(rows: NDArray[np.float32]) -> NDArray[np.float64]:
    t = rows.astype(np.float64)
    return np.where(t > 0, t * np.log(np.where(t > 0, t, 1.0)), 0.0).sum(axis=1)


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "nsz"}, error_model="numpy")
def _jsd_matrix(
    queries: NDArray[np.float32],
    prototypes: NDArray[np.float32],
    of_queries: NDArray[np.float64],
    of_prototypes: NDArray[np.float64],
) -> NDArray[np.float32]:
    """The logarithm is a polynomial on [sqrt(1/2), sqrt(2)), so that the inner loop runs on vectors."""
    out = np.empty((len(queries), len(prototypes)), np.float32)
    bins = queries.shape[1]
    mixed = np.empty(bins, np.float32)
    bits = mixed.view(np.int32)
    mantissa = np.empty(bins, np.float32)
    mantissa_bits = mantissa.view(np.int32)
    exponent = np.empty(bins, np.int32)
    for i in range(len(queries)):
        for j in range(len(prototypes)):
            for b in range(bins):
                mixed[b] = queries[i, b] + prototypes[j, b] + np.float32(1e-30)
            for b in range(bins):
                e = (bits[b] - 0x3F3504F3) >> 23
                exponent[b] = e
                mantissa_bits[b] = bits[b] - (e << 23)
            total = np.float32(0.0)
            for b in range(bins):
                total += mixed[b] * _log(mantissa[b], np.float32(exponent[b]))
            jsd = LN2 + 0.5 * (of_queries[i] + of_prototypes[j] - total)
            out[i, j] = max(jsd, 0.0)
    return out


@njit(inline="always")
def _log(mantissa: np.float32, exponent: np.float32) -> np.float32:
    """Natural logarithm of mantissa * 2^exponent for a mantissa in [sqrt(1/2), sqrt(2)), to 1e-7 (Cephes logf)."""
    x = mantissa - np.float32(1.0)
    z = x * x
    y = np.float32(7.0376836292e-2)
    y = y * x - np.float32(1.1514610310e-1)
    y = y * x + np.float32(1.1676998740e-1)
    y = y * x - np.float32(1.2420140846e-1)
    y = y * x + np.float32(1.4249322787e-1)
    y = y * x - np.float32(1.6668057665e-1)
    y = y * x + np.float32(2.0000714765e-1)
    y = y * x - np.float32(2.4999993993e-1)
    y = y * x + np.float32(3.3333331174e-1)
    y = y * x * z - np.float32(0.5) * z
    return x + y + exponent * np.float32(0.6931471805599453)
