"""Lower bounds of the Jensen-Shannon divergence that cost next to nothing: what few coarse dimensions tell of it.

Csiszar, "Information-type measures of difference of probability distributions", Studia Sci. Math. Hungar. 2 (1967):
no f-divergence grows when dimensions are added up. Topsoe, "Some inequalities for information divergence", IEEE Trans.
Information Theory 46 (2000): JSD(p, q) >= ln 2 h^2(p, q), where h^2 = 1/2 sum (sqrt p - sqrt q)^2 is Hellinger's.
So ln 2 / 2 times the squared Euclidean distance between the roots of coarse distributions is never above the JSD.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import csr_array

from service.engine.divergence import LN2
from worker.learning.dictionary import principal_direction

SAMPLE = 32  # vectors that tell which dimensions go together: any would do, these only say how tight the bound is


def coarsen(rows: csr_array, total: NDArray[np.float64], levels: int) -> NDArray[np.float64]:
    """What `at_least` compares: roots of the distributions (N, at most 2^levels), alike dimensions added up.

    Args:
        rows: (N, V) sparse, non-negative.
        total: (N,) of each row; 1 for a row of zeros.
        levels: of bisection of the dimensions.
    """
    group = _groups(rows, levels)
    column = group[rows.indices].astype(np.int64)
    width = int(group.max(initial=0)) + 1
    sums = np.empty((rows.shape[0], width))
    for i, (start, stop) in enumerate(zip(rows.indptr[:-1].tolist(), rows.indptr[1:].tolist(), strict=True)):
        sums[i] = np.bincount(column[start:stop], rows.data[start:stop], minlength=width) / total[i]
    return np.sqrt(sums)


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def at_least(coarse: NDArray[np.float64], i: int, j: int) -> float:
    """A lower bound of the JSD of vectors i and j, nats, but for rounding."""
    squared = 0.0
    for k in range(coarse.shape[1]):
        difference = coarse[i, k] - coarse[j, k]
        squared += difference * difference
    return 0.5 * LN2 * squared


def _groups(rows: csr_array, levels: int) -> NDArray[np.int64]:
    """The group of each dimension (V,): halves of halves, across the principal direction of how they vary together."""
    picked = np.unique(np.linspace(0, rows.shape[0] - 1, min(SAMPLE, rows.shape[0])).astype(int))
    profiles = np.sqrt(rows[picked].toarray().T.astype(np.float64))  # (V, SAMPLE)
    groups = [np.arange(rows.shape[1])]
    for _ in range(levels):
        groups = [half for members in groups for half in _halves(profiles, members)]
    out = np.empty(rows.shape[1], np.int64)
    for number, members in enumerate(groups):
        out[members] = number
    return out


def _halves(profiles: NDArray[np.float64], members: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    own = profiles[members] - profiles[members].mean(axis=0)
    if len(members) < 2 or np.abs(own).max() == 0:
        return [members]
    side = own @ principal_direction(own) > 0
    return [half for half in (members[~side], members[side]) if len(half)]
