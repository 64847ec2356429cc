"""The bound in single precision: never above the divergence, and little below it where vectors are alike."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import rel_entr

from tests.learnt import learnt
from worker.learning.fine import nearly

LN2 = np.log(2)


def exact(p: NDArray[np.float64], q: NDArray[np.float64]) -> float:
    """The plain twin, in double precision."""
    middle = (p + q) / 2
    return float(rel_entr(p, middle).sum() + rel_entr(q, middle).sum()) / 2


def bound(p: NDArray[np.float64], q: NDArray[np.float64]) -> float:
    indices = np.flatnonzero(q).astype(np.uint32)
    data = (3 * q[indices]).astype(np.float32)
    return nearly(p.astype(np.float32), bool(p.any()), indices, data, 0, len(data), float(data.sum(dtype=np.float64)))


def normalised(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    return rows / np.maximum(rows.sum(axis=1, keepdims=True), 1e-300)


@pytest.mark.parametrize("spread", [1e-7, 1e-5, 1e-3, 0.03, 0.3, 1.0, 4.0])
@pytest.mark.parametrize("dimensions", [3, 300, 5000])
def test_a_bound_is_never_above_the_divergence_and_close_to_it(spread: float, dimensions: int):
    rng = np.random.default_rng(dimensions)
    p = rng.gamma(0.5, size=dimensions) + 1e-6
    p, q = normalised(np.stack([p, p * np.exp(spread * rng.standard_normal(dimensions))]))
    told, true = bound(p, q), exact(p, q)
    assert told <= true
    assert told >= 0.985 * true - 1e-9


@pytest.mark.parametrize("fill", [0.02, 0.3, 0.9])
def test_what_only_one_of_the_two_has_counts_as_well(fill: float):
    rng = np.random.default_rng(1)
    for _ in range(20):
        rows = rng.gamma(0.5, size=(2, 400)) * (rng.random((2, 400)) < fill)
        p, q = normalised(rows)
        assert 0.98 * exact(p, q) - 1e-4 <= bound(p, q) <= exact(p, q)
    assert bound(p, np.zeros(400)) <= LN2
    assert bound(np.zeros(400), q) <= LN2
    assert bound(np.zeros(400), np.zeros(400)) <= 0


def test_real_stimuli_lose_less_than_a_hundredth():
    rows = normalised(learnt().stimuli.toarray().astype(np.float64))
    for i in range(len(rows)):
        for j in range(i):
            assert 0.99 * exact(rows[i], rows[j]) <= bound(rows[i], rows[j]) <= exact(rows[i], rows[j])


def test_equal_vectors_and_one_hot_ones():
    hot = np.eye(4)
    assert bound(hot[0], hot[0]) <= 0
    assert 0.98 * LN2 < bound(hot[0], hot[1]) <= LN2
