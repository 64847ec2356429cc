"""Lower bounds: never above the divergence itself, and close to it where dimensions go together."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.spatial.distance import jensenshannon

from tests.learnt import learnt
from worker.learning.coarse import at_least, project


def totals(rows: csr_array) -> np.ndarray:
    total = rows.toarray().astype(np.float64).sum(axis=1)
    return np.where(total > 0, total, 1.0)


def random_rows(seed: int, fill: float) -> csr_array:
    rng = np.random.default_rng(seed)
    return csr_array((rng.gamma(0.3, size=(25, 80)) * (rng.random((25, 80)) < fill)).astype(np.float32))


@pytest.mark.parametrize("dimensions", [1, 4, 16, 80])
@pytest.mark.parametrize("rows", [random_rows(0, 1.0), random_rows(1, 0.2), random_rows(2, 0.02), learnt().stimuli])
def test_a_bound_is_never_above_the_divergence(rows: csr_array, dimensions: int):
    coarse, dense = project(rows, totals(rows), dimensions), rows.toarray().astype(np.float64)
    assert coarse.shape[1] < dimensions + 4
    for i in range(len(dense)):
        for j in range(i):
            if dense[i].any() and dense[j].any():
                assert at_least(coarse, i, j) <= jensenshannon(dense[i], dense[j]) ** 2 + 1e-12
            else:
                assert at_least(coarse, i, j) <= np.log(2) / 2 * (dense[i].any() or dense[j].any()) + 1e-12


def test_more_dimensions_tell_more_and_real_stimuli_lose_little():
    rows = learnt().stimuli
    dense = rows.toarray().astype(np.float64)
    exact = {(i, j): jensenshannon(dense[i], dense[j]) ** 2 for i in range(len(dense)) for j in range(i)}
    shares = []
    for dimensions in (1, 8, 14):
        coarse = project(rows, totals(rows), dimensions)
        shares.append(np.mean([at_least(coarse, *pair) / jsd for pair, jsd in exact.items()]))
    assert shares[0] < shares[1] < shares[2] + 1e-12
    assert shares[2] > 0.65  # of at most ln 2, or 0.69 where vectors are alike


def test_vectors_that_vary_in_few_ways_lose_nothing():
    """Each dimension thrice, in fixed shares: the roots of 36 dimensions lie in a space of 12."""
    rng = np.random.default_rng(3)
    rows = rng.gamma(0.5, size=(10, 12))
    thrice = csr_array(np.concatenate([0.2 * rows, 0.3 * rows, 0.5 * rows], axis=1)[:, rng.permutation(36)])
    coarse = project(thrice, totals(thrice), 12)
    fine = np.sqrt(rows / rows.sum(axis=1, keepdims=True))
    for i in range(10):
        for j in range(i):
            assert at_least(coarse, i, j) == pytest.approx(np.log(2) / 2 * ((fine[i] - fine[j]) ** 2).sum())


@pytest.mark.parametrize("threads", [2, 3, 40])
def test_coordinates_are_the_same_for_any_number_of_threads(threads: int):
    rows = random_rows(4, 0.3)
    assert np.array_equal(project(rows, totals(rows), 8, threads), project(rows, totals(rows), 8))
