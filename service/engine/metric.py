"""The distance between stimuli vectors in which objects are compared with concepts (Sec. Shape Concept Inference)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array


@dataclass(frozen=True)
class Metric:
    """The Mahalanobis distance between stimuli vectors, as a linear embedding in which it is Euclidean.

    d^2(a, b) = |(f(a) - f(b)) W|^2 + |r(a) - r(b)|^2 / v, where f (takes, if asked, a power of the vector
    normalised to sum 1, and) weighs each dimension, and r is what of f lies outside the subspace.

    Attributes:
        weights: (V,) float32: of each dimension, after the power.
        mean: (V,) float32.
        components: (k, V) float32: orthonormal.
        variance: (k,) float64: along each component.
        residual_variance: v, outside the components; infinite where only the subspace counts.
        power: to which vectors normalised to sum 1 are raised before they are compared; 1: raw vectors.
    """

    weights: NDArray[np.float32]
    mean: NDArray[np.float32]
    components: NDArray[np.float32]
    variance: NDArray[np.float64]
    residual_variance: float
    power: float

    def embed_one(self, indices: NDArray[np.int32], values: NDArray[np.float32]) -> NDArray[np.float64]:
        """Coordinates (k,) of one stimuli vector, given by its entries: what `embed` says, to rounding."""
        data = _powers(values.astype(np.float64), float(values.sum(dtype=np.float64)), self.power)
        return np.asarray((data * self.weights[indices]) @ self._projection[indices] - self._origin)

    @cached_property
    def _projection(self) -> NDArray[np.float64]:
        """(V, k): what a feature counts along each component, in standard deviations."""
        return np.ascontiguousarray(self.components.T.astype(np.float64) / np.sqrt(self.variance))

    @cached_property
    def _origin(self) -> NDArray[np.float64]:
        """Coordinates (k,) of the mean."""
        return np.asarray(self.mean.astype(np.float64) @ self._projection)

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
        return features(stimuli, self.weights, self.power)


def features(stimuli: csr_array, weights: NDArray[np.float32], power: float) -> csr_array:
    """Weighted stimuli vectors (n, V), or weighted powers of those normalised to sum 1."""
    rows = csr_array(stimuli)
    data = rows.data.astype(np.float64)
    if power != 1:
        total = np.asarray(csr_array((data, rows.indices, rows.indptr), shape=rows.shape).sum(axis=1)).ravel()
        data = _powers(data, np.repeat(total, np.diff(rows.indptr)), power)
    data *= weights[rows.indices]
    return csr_array((data, rows.indices, rows.indptr), shape=rows.shape)


def _powers(data: NDArray[np.float64], total: NDArray[np.float64] | float, power: float) -> NDArray[np.float64]:
    """A power of values over the sum of their vector; raw ones where the power is 1."""
    if power == 1:
        return data
    shares = data / np.where(np.greater(total, 0), total, 1.0)
    if power in (0.5, 0.25):  # roots are far quicker, and rounded better
        return np.sqrt(shares) if power == 0.5 else np.sqrt(np.sqrt(shares))
    return np.asarray(np.power(shares, power))
