"""Lower bounds of the Jensen-Shannon divergence that cost next to nothing: what few coordinates tell of it.

Topsoe, "Some inequalities for information divergence", IEEE Trans. Information Theory 46 (2000): JSD(p, q) >=
ln 2 h^2(p, q), where h^2 = 1/2 sum (sqrt p - sqrt q)^2 is Hellinger's. No orthogonal projection lengthens a vector, so
ln 2 / 2 times the squared Euclidean distance between projected roots is never above the JSD. The projection is onto the
principal directions of a sample: stimuli of objects vary in few ways, so that 16 of thousands tell nearly all.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import csr_array

from service.engine.divergence import LN2

SAMPLE = 128  # vectors that tell the directions: any would do, these only say how tight the bound is
CELLS = 2**22  # or fewer, of so many entries together: bounds the memory


def project(rows: csr_array, total: NDArray[np.float64], dimensions: int, threads: int = 1) -> NDArray[np.float64]:
    """What `at_least` compares: coordinates (N, k) of the roots of the distributions; k is little over `dimensions`.

    Args:
        rows: (N, V) sparse, non-negative.
        total: (N,) of each row; 1 for a row of zeros.
        dimensions: at least 1.
        threads: at least 1; each coordinate is the same for any number.
    """
    directions = _directions(rows, total, dimensions)
    out = np.zeros((rows.shape[0], directions.shape[1]))
    ends = np.linspace(0, len(out), threads + 1).astype(int).tolist()
    with ThreadPoolExecutor(threads) as pool:
        shares = [
            pool.submit(_coordinates, a, b, rows.indptr, rows.indices, rows.data, total, directions, out)
            for a, b in pairwise(ends)
        ]
        for share in shares:
            share.result()
    return out


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def at_least(coarse: NDArray[np.float64], i: int, j: int) -> float:
    """A lower bound of the JSD of vectors i and j, nats, but for rounding."""
    squared = 0.0
    for k in range(coarse.shape[1]):
        difference = coarse[i, k] - coarse[j, k]
        squared += difference * difference
    return 0.5 * LN2 * squared


def _directions(rows: csr_array, total: NDArray[np.float64], dimensions: int) -> NDArray[np.float64]:
    """Orthonormal directions (V, k) in which the roots of a sample vary most, and zeros to a multiple of four."""
    count = int(np.clip(CELLS // max(rows.shape[1], 1), 2, SAMPLE))
    picked = np.unique(np.linspace(0, rows.shape[0] - 1, min(count, rows.shape[0])).astype(int))
    roots = np.sqrt(rows[picked].toarray().astype(np.float64) / total[picked, None])
    roots -= roots.mean(axis=0)
    _, turned = np.linalg.eigh(roots @ roots.T)
    strongest = turned[:, ::-1][:, : min(dimensions, *rows.shape)]
    directions = np.linalg.qr(roots.T @ strongest)[0]
    return np.pad(directions, ((0, 0), (0, -directions.shape[1] % 4)))


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def _coordinates(
    first: int,
    last: int,
    indptr: NDArray[np.integer],
    indices: NDArray[np.integer],
    data: NDArray[np.floating],
    total: NDArray[np.float64],
    directions: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    """Four coordinates at a time, as many as a vector instruction takes."""
    for i in range(first, last):
        columns = indices[indptr[i] : indptr[i + 1]]
        roots = np.sqrt(data[indptr[i] : indptr[i + 1]] / total[i])
        for d in range(0, out.shape[1], 4):
            a, b, c, e = 0.0, 0.0, 0.0, 0.0
            for k in range(len(columns)):
                of = directions[columns[k]]
                a += roots[k] * of[d]
                b += roots[k] * of[d + 1]
                c += roots[k] * of[d + 2]
                e += roots[k] * of[d + 3]
            out[i, d], out[i, d + 1], out[i, d + 2], out[i, d + 3] = a, b, c, e
