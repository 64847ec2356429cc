"""t-SNE by all pairs, for as many objects as that is the fastest way for.

Van der Maaten and Hinton, "Visualizing Data using t-SNE", JMLR 9 (2008), with the affinities of the nearest neighbours
alone and the schedule of scikit-learn, whose Barnes-Hut approximation it replaces where N is small.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import csr_array

NEIGHBOURS = 3  # times the perplexity: farther ones have no affinity
EXAGGERATION, EXAGGERATED = 12.0, 250  # by how much affinities are exaggerated at first, and for how many steps
STEPS = 1000
SLOWEST = 50.0  # learning rate, at least
LEAST_GAIN = 0.01
STILL = 1e-7  # norm of the gradient at which all is done
HALVINGS = 100  # of the search for a bandwidth
EXACT = 1e-5  # how far from the perplexity's logarithm an entropy may be


def embed(coordinates: NDArray[np.float64], perplexity: float, start: NDArray[np.float64]) -> NDArray[np.float64]:
    """Places (N, 2) in which those are near to one another that are in their coordinates (N, k).

    Args:
        coordinates: of at least 2 objects.
        perplexity: to about how many each is near; less than N.
        start: (N, 2) from where the places move.
    """
    affinity = affinities(coordinates, perplexity)
    rate = max(len(coordinates) / EXAGGERATION / 4, SLOWEST)
    return _descend(affinity.indptr, affinity.indices, affinity.data, start.copy(), rate)


def affinities(coordinates: NDArray[np.float64], perplexity: float) -> csr_array:
    """Affinities P (N, N), symmetric, of sum 1: Gaussians whose bandwidths give each object the same perplexity."""
    size = len(coordinates)
    count = min(size - 1, int(NEIGHBOURS * perplexity + 1))
    squared = ((coordinates[:, None] - coordinates[None]) ** 2).sum(axis=2)
    np.fill_diagonal(squared, np.inf)
    near = np.argsort(squared, axis=1, kind="stable")[:, :count]
    near.sort(axis=1)
    share = _shares(np.take_along_axis(squared, near, axis=1), np.log(perplexity))
    one_way = csr_array((share.ravel(), near.ravel(), np.arange(0, size * count + 1, count)), shape=(size, size))
    both = csr_array(one_way + one_way.T)
    return both / both.sum()


@njit(cache=True, nogil=True)
def _shares(squared: NDArray[np.float64], entropy: float) -> NDArray[np.float64]:
    """For each row of squared distances (N, k) shares that sum to 1, of a Gaussian and of that entropy, nats."""
    out = np.empty_like(squared)
    for i in range(len(squared)):
        nearest = squared[i].min()
        beta, low, high = 1.0, 0.0, np.inf
        for _ in range(HALVINGS):
            out[i] = np.exp(-beta * (squared[i] - nearest))
            total = out[i].sum()
            off = np.log(total) + beta * (out[i] * (squared[i] - nearest)).sum() / total - entropy
            out[i] /= total
            if abs(off) <= EXACT:
                break
            if off > 0:
                low = beta
                beta = beta * 2 if high == np.inf else (beta + high) / 2
            else:
                high = beta
                beta = (beta + low) / 2
    return out


@njit(cache=True, nogil=True)
def _descend(
    indptr: NDArray[np.integer],
    indices: NDArray[np.integer],
    affinity: NDArray[np.float64],
    place: NDArray[np.float64],
    rate: float,
) -> NDArray[np.float64]:
    """Gradient descent with momentum, and a gain for each coordinate."""
    x, y = place[:, 0].copy(), place[:, 1].copy()
    size = len(x)
    step, gain, slope = np.zeros((size, 2)), np.ones((size, 2)), np.empty((size, 2))
    for turn in range(STEPS):
        exaggeration = EXAGGERATION if turn < EXAGGERATED else 1.0
        momentum = 0.5 if turn < EXAGGERATED else 0.8
        if turn == EXAGGERATED:
            step[:], gain[:] = 0.0, 1.0
        _slope(indptr, indices, affinity, x, y, exaggeration, slope)
        squared = 0.0
        for i in range(size):
            for axis in range(2):
                s = slope[i, axis]
                squared += s * s
                rising = step[i, axis] * s < 0.0
                gain[i, axis] = max(gain[i, axis] + 0.2 if rising else gain[i, axis] * 0.8, LEAST_GAIN)
                step[i, axis] = momentum * step[i, axis] - rate * gain[i, axis] * s
            x[i] += step[i, 0]
            y[i] += step[i, 1]
        if np.sqrt(squared) <= STILL:
            break
    place[:, 0], place[:, 1] = x, y
    return place


@njit(cache=True, nogil=True)
def _slope(
    indptr: NDArray[np.integer],
    indices: NDArray[np.integer],
    affinity: NDArray[np.float64],
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    exaggeration: float,
    out: NDArray[np.float64],
) -> None:
    """Gradient of the Kullback-Leibler divergence: 4 sum over j of (p_ij - q_ij) (y_i - y_j) / (1 + |y_i - y_j|^2)."""
    total = 0.0
    for i in range(len(x)):
        mass, out[i, 0], out[i, 1] = _push(x, y, x[i], y[i])
        total += mass - 1.0  # itself
    for i in range(len(x)):
        a, b = 0.0, 0.0
        for k in range(indptr[i], indptr[i + 1]):
            right, up = x[i] - x[indices[k]], y[i] - y[indices[k]]
            pull = affinity[k] / (1.0 + right * right + up * up)
            a += pull * right
            b += pull * up
        out[i, 0] = 4.0 * (exaggeration * a - out[i, 0] / total)
        out[i, 1] = 4.0 * (exaggeration * b - out[i, 1] / total)


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"}, error_model="numpy")
def _push(x: NDArray[np.float64], y: NDArray[np.float64], own_x: float, own_y: float) -> tuple[float, float, float]:
    """Sums over all places of the kernel w = 1 / (1 + d^2), and of w^2 times the way from each."""
    mass, a, b = 0.0, 0.0, 0.0
    for j in range(len(x)):
        right, up = own_x - x[j], own_y - y[j]
        w = 1.0 / (1.0 + right * right + up * up)
        mass += w
        a += w * w * right
        b += w * w * up
    return mass, a, b
