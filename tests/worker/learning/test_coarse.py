"""Lower bounds: never above the divergence itself, and close to it where dimensions go together."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.spatial.distance import jensenshannon

from tests.learnt import learnt
from worker.learning.coarse import at_least, coarsen


def totals(rows: csr_array) -> np.ndarray:
    total = rows.toarray().astype(np.float64).sum(axis=1)
    return np.where(total > 0, total, 1.0)


def random_rows(seed: int, fill: float) -> csr_array:
    rng = np.random.default_rng(seed)
    return csr_array((rng.gamma(0.3, size=(25, 80)) * (rng.random((25, 80)) < fill)).astype(np.float32))


@pytest.mark.parametrize("levels", [0, 1, 4, 8])
@pytest.mark.parametrize("rows", [random_rows(0, 1.0), random_rows(1, 0.2), random_rows(2, 0.02), learnt().stimuli])
def test_a_bound_is_never_above_the_divergence(rows: csr_array, levels: int):
    coarse, dense = coarsen(rows, totals(rows), levels), rows.toarray().astype(np.float64)
    assert coarse.shape[1] <= 2**levels
    for i in range(len(dense)):
        for j in range(i):
            if dense[i].any() and dense[j].any():
                assert at_least(coarse, i, j) <= jensenshannon(dense[i], dense[j]) ** 2 + 1e-12
            else:
                assert at_least(coarse, i, j) <= np.log(2) / 2 * (dense[i].any() or dense[j].any()) + 1e-12


def test_finer_dimensions_tell_more_and_real_stimuli_lose_little():
    rows = learnt().stimuli
    dense = rows.toarray().astype(np.float64)
    exact = {(i, j): jensenshannon(dense[i], dense[j]) ** 2 for i in range(len(dense)) for j in range(i)}
    shares = []
    for levels in (0, 4, 8):
        coarse = coarsen(rows, totals(rows), levels)
        shares.append(np.mean([at_least(coarse, *pair) / jsd for pair, jsd in exact.items()]))
    assert shares[0] < 1e-9
    assert shares[0] < shares[1] < shares[2]
    assert shares[2] > 0.6


def test_dimensions_that_go_together_are_added_up_without_loss():
    """Each dimension thrice, in fixed shares: 12 groups tell all that 36 dimensions do."""
    rng = np.random.default_rng(3)
    rows = rng.gamma(0.5, size=(10, 12))
    thrice = csr_array(np.concatenate([0.2 * rows, 0.3 * rows, 0.5 * rows], axis=1)[:, rng.permutation(36)])
    coarse = coarsen(thrice, totals(thrice), 12)
    fine = np.sqrt(rows / rows.sum(axis=1, keepdims=True))
    for i in range(10):
        for j in range(i):
            assert at_least(coarse, i, j) == pytest.approx(np.log(2) / 2 * ((fine[i] - fine[j]) ** 2).sum())
