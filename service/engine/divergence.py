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
BLOCK = 256  # others that are compared at a time


class Distributions(NamedTuple):
    """Distributions to be compared with many others, with what needs to be computed of them but once.

    Attributes:
        rows: (P, D) float32; each sums to 1.
        columns: (D, P) float32, contiguous: the same, bin after bin.
        terms: (D, P) float32: t ln t of each.
        negentropy: (P,) float64: the sum of t ln t over each row.
    """

    rows: NDArray[np.float32]
    columns: NDArray[np.float32]
    terms: NDArray[np.float32]
    negentropy: NDArray[np.float64]

    def of(self, rows: NDArray[np.int64]) -> Distributions:
        """Some of them."""
        return distributions(self.rows[rows])


def distributions(rows: NDArray[np.float32]) -> Distributions:
    """Rows (P, D) that each sum to 1."""
    columns = np.ascontiguousarray(rows.T)
    terms = _t_log_t(columns)
    return Distributions(rows, columns, terms.astype(np.float32), terms.sum(axis=0))


def jsd_matrix(queries: NDArray[np.float32], others: Distributions) -> NDArray[np.float32]:
    """Jensen-Shannon divergence in nats, to about 1e-6, of every two rows that each sum to 1; (C, P) float32.

    JSD(p, q) = H((p + q) / 2) - H(p) / 2 - H(q) / 2 = ln 2 + sum [x(p) + x(q) - x(p + q)] / 2 with x(t) = t ln t. Of a
    pair one logarithm is left for each bin that the query fills: where it is empty, x(q) - x(p + q) is 0.
    """
    negentropy = _t_log_t(queries).sum(axis=1)
    return _jsd_matrix(np.ascontiguousarray(queries), others.columns, others.terms, negentropy)


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


def _t_log_t(values: NDArray[np.float32]) -> NDArray[np.float64]:
    t = values.astype(np.float64)
    return np.asarray(t * np.log(np.where(t > 0, t, 1.0)))


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"}, error_model="numpy")
def _jsd_matrix(
    queries: NDArray[np.float32],
    columns: NDArray[np.float32],
    terms: NDArray[np.float32],
    negentropy: NDArray[np.float64],
) -> NDArray[np.float32]:
    """Bin after bin for a block of others, so that the inner loop runs on vectors that lie in the nearest cache."""
    count = columns.shape[1]
    out = np.empty((len(queries), count), np.float32)
    for i in range(len(queries)):
        for start in range(0, count, BLOCK):
            block = slice(start, min(start + BLOCK, count))
            shared = out[i, block]
            shared[:] = 0.0
            for b in range(len(columns)):
                if queries[i, b] > 0:
                    _add_terms(queries[i, b], columns[b, block], terms[b, block], shared)
            for j in range(len(shared)):
                shared[j] = max(LN2 + 0.5 * (negentropy[i] - shared[j]), 0.0)
    return out


@njit(nogil=True, fastmath={"contract", "nsz"}, error_model="numpy", inline="always")
def _add_terms(
    query: np.float32, others: NDArray[np.float32], terms: NDArray[np.float32], shared: NDArray[np.float32]
) -> None:
    """Adds x(p + q) - x(p) of one bin, in place."""
    for j in range(len(shared)):
        mixed = np.float32(query + others[j])
        shared[j] += mixed * _log(mixed) - terms[j]


@njit(inline="always")
def _log(value: np.float32) -> np.float32:
    """Natural logarithm of a normal number, to 1e-7 (Cephes logf): a polynomial on [sqrt(1/2), sqrt(2))."""
    bits = np.float32(value).view(np.int32)
    exponent = (bits - np.int32(0x3F3504F3)) >> np.int32(23)
    x = np.int32(bits - (exponent << np.int32(23))).view(np.float32) - np.float32(1.0)
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
    return x + y + np.float32(exponent) * np.float32(0.6931471805599453)
