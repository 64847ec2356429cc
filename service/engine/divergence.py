"""The Jensen-Shannon divergence: of many dense vectors at once for stimuli, of sparse ones for the tree.

Lin, "Divergence Measures Based on the Shannon Entropy", IEEE Trans. Information Theory 37 (1991).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

LN2 = float(np.log(2.0))
ALIKE = 1 / 16  # squared relative difference up to which eleven terms of the series are all that doubles can tell
NOTHING = 1e-12  # a sum of parts of 1 that differs by less from 1 is 1


class Distributions(NamedTuple):
    """Distributions to be compared with many others, with what needs to be computed of them but once.

    Attributes:
        rows: (P, D) float32, contiguous; each sums to 1.
        negentropy: (P,) float64: the sum of t ln t over each row.
    """

    rows: NDArray[np.float32]
    negentropy: NDArray[np.float64]

    def of(self, rows: NDArray[np.int64]) -> Distributions:
        """Some of them."""
        return Distributions(self.rows[rows], self.negentropy[rows])


def distributions(rows: NDArray[np.float32]) -> Distributions:
    """Rows (P, D) that each sum to 1."""
    return Distributions(np.ascontiguousarray(rows), _sum_t_log_t(rows))


def jsd_matrix(queries: NDArray[np.float32], others: Distributions) -> NDArray[np.float32]:
    """Jensen-Shannon divergence in nats, to about 1e-6, of every two rows that each sum to 1; (C, P) float32.

    JSD(p, q) = H((p + q) / 2) - H(p) / 2 - H(q) / 2 = ln 2 + sum [x(p) + x(q) - x(p + q)] / 2 with x(t) = t ln t, so
    that one logarithm a bin is left for each pair.
    """
    return _jsd_matrix(np.ascontiguousarray(queries), others.rows, _sum_t_log_t(queries), others.negentropy)


@njit(cache=True, nogil=True)
def sparse_jsd(
    p: NDArray[np.float64],
    filled: bool,
    indices: NDArray[np.integer],
    data: NDArray[np.floating],
    start: int,
    stop: int,
    total: float = 1.0,
) -> float:
    """JSD(p, q) = 1/2 sum over the shared support of [p ln(2p / (p + q)) + q ln(2q / (p + q))] + ln 2 / 2 rest, nats.

    The rest is what both have elsewhere. Vectors that are equal are 0 apart, those alike not much less exactly than
    others: with u = p + q and v = (p - q) / u an entry adds u / 2 (v^2 / 2 + v^4 / 12 + v^6 / 30 + ...), where nothing
    cancels. The order of the two makes no difference, bit for bit.

    Args:
        p: (V,) dense, of sum 1, or of zeros.
        filled: whether p is not all zeros.
        indices: where the entries of all sparse vectors stand.
        data: the entries.
        start: of the entries of q.
        stop: of them.
        total: their sum: q is what they are divided by it.
    """
    if not filled or start == stop:
        return LN2 if filled or start < stop else 0.0
    shared, other = np.empty(stop - start), np.empty(stop - start)
    for k in range(stop - start):
        shared[k], other[k] = p[indices[start + k]], data[start + k] / total
    terms, ratios = _terms_of_alike(shared, other)
    both, of_p, of_q = 0.0, 0.0, 0.0
    for k in range(stop - start):
        a, b = shared[k], other[k]
        if a == 0.0 or b == 0.0:
            continue
        if ratios[k] <= ALIKE:
            both += terms[k]
        else:
            both += a * np.log(2 * a / (a + b)) + b * np.log(2 * b / (a + b))
        of_p += a
        of_q += b
    return 0.5 * (both + LN2 * (_rest(of_p) + _rest(of_q)))


@njit(inline="always")
def _rest(part: float) -> float:
    """What is left of 1, but for rounding."""
    return 1.0 - part if 1.0 - part > NOTHING else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _terms_of_alike(p: NDArray[np.float64], q: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What an entry adds, u (v^2 / 2 + v^4 / 12 + ...), and v^2, by which to tell whether the sum is long enough."""
    terms, ratios = np.empty(len(p)), np.empty(len(p))
    for k in range(len(p)):
        u = p[k] + q[k]
        v = (p[k] - q[k]) / u
        w = v * v
        terms[k], ratios[k] = u * _series(w), w
    return terms, ratios


@njit(inline="always")
def _series(w: float) -> float:
    """The sum of w^k / (2 k (2 k - 1)) for k from 1 to 11."""
    s = w * (1 / 462) + 1 / 380
    s = s * w + 1 / 306
    s = s * w + 1 / 240
    s = s * w + 1 / 182
    s = s * w + 1 / 132
    s = s * w + 1 / 90
    s = s * w + 1 / 56
    s = s * w + 1 / 30
    s = s * w + 1 / 12
    return (s * w + 1 / 2) * w


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
