"""Learning the metric in which objects are compared with concepts (Sec. Shape Concept Inference, Eq. 4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.linalg import LinearOperator, svds

from service.engine.metric import Metric, features
from service.engine.params import ResponseParams

NEGLIGIBLE = 1e-9  # components of less than this share of the largest variance are rounding
ALIKE = 1e-12  # variance below which all samples are alike, but for the rounding of float32


def learn_metric(stimuli: csr_array, params: ResponseParams) -> Metric:
    """The Mahalanobis distance between stimuli vectors, from the covariance of the training objects' own.

    There are more dimensions than samples, so the covariance is that of the strongest components alone ("subspace"),
    or a regularised full one: its diagonal, Ledoit and Wolf's shrinkage, or the identity. Samples that are all alike
    have none: the identity stands for it.

    Args:
        stimuli: (N, V) sparse, N at least 2.
        params: which metric.
    """
    weights = _weights(stimuli, params)
    rows = features(stimuli, weights, params.power)
    mean = np.asarray(rows.mean(axis=0)).ravel()
    limit = params.dimensions if params.metric == "subspace" else min(rows.shape[0] - 1, rows.shape[1])
    components, variance = _principal_components(rows, mean, max(limit, 1))
    residual = float("inf")
    if params.metric in ("identity", "diagonal") or variance[0] <= ALIKE:
        variance, residual = np.ones_like(variance), 1.0
    elif params.metric == "shrunk":
        variance, residual = _shrink(rows, mean, variance)
    return Metric(weights, mean.astype(np.float32), components.astype(np.float32), variance, residual, params.power)


def _weights(stimuli: csr_array, params: ResponseParams) -> NDArray[np.float32]:
    """1, or for the diagonal covariance the inverse standard deviation of each dimension (0 where nothing varies)."""
    weights = np.ones(stimuli.shape[1], np.float32)
    if params.metric != "diagonal":
        return weights
    rows = features(stimuli, weights, params.power)
    mean = np.asarray(rows.mean(axis=0)).ravel()
    variance = np.asarray(rows.multiply(rows).mean(axis=0)).ravel() - mean**2
    varies = variance > max(NEGLIGIBLE * variance.max(), ALIKE)
    return np.where(varies, 1 / np.sqrt(np.where(varies, variance, 1.0)), 0.0).astype(np.float32)


def _principal_components(
    rows: csr_array, mean: NDArray[np.float64], limit: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """At most `limit` components (k, V), strongest first, their largest entries positive, and the variances (k,)."""
    size = rows.shape[0]
    if limit >= min(rows.shape) // 2 or rows.nnz == 0:
        _, singular, components = np.linalg.svd(rows.toarray() - mean, full_matrices=False)
    else:
        centred = LinearOperator(
            rows.shape,
            matvec=lambda v: rows @ v.ravel() - mean @ v.ravel(),
            rmatvec=lambda u: rows.T @ u.ravel() - mean * u.sum(),
            dtype=np.float64,
        )
        _, singular, components = svds(centred, k=limit, v0=np.ones(min(rows.shape)) + np.arange(min(rows.shape)) % 7)
    order = np.argsort(-singular, kind="stable")[:limit]
    variance, components = singular[order] ** 2 / (size - 1), components[order]
    kept = variance > NEGLIGIBLE * max(variance[0], np.finfo(float).tiny)
    kept[0] = True
    variance, components = np.maximum(variance[kept], np.finfo(float).tiny), components[kept]
    largest = np.take_along_axis(components, np.abs(components).argmax(axis=1)[:, None], axis=1)
    return components * np.where(largest < 0, -1.0, 1.0), variance


def _shrink(
    rows: csr_array, mean: NDArray[np.float64], variance: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float]:
    """Variances inside and outside the samples' span after Ledoit and Wolf, JMVA 88 (2004): (1 - a) S + a m I."""
    size, dimensions = rows.shape
    centred = rows.toarray() - mean
    spread = variance * (size - 1) / size
    target = spread.sum() / dimensions
    norms = (centred**2).sum(axis=1)
    off = (spread**2).sum() - dimensions * target**2
    noise = (np.sum(norms**2) / size - (spread**2).sum()) / size
    amount = float(np.clip(noise / off, 0, 1)) if off > 0 else 1.0
    floor = max(amount * target, NEGLIGIBLE * spread[0])  # of two samples nothing is shrunk
    return (1 - amount) * spread + floor, floor
