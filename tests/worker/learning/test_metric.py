"""The metric of Eq. 4 against explicit inverse covariances."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import csr_array
from sklearn.covariance import LedoitWolf
from sklearn.decomposition import PCA

from service.engine.metric import Metric
from service.engine.params import ResponseParams
from tests.learnt import learnt
from worker.learning.metric import learn_metric

all_powers = pytest.mark.parametrize("power", [1.0, 0.5, 0.25])
SHAPES = {"more dimensions than samples": (12, 30), "more samples than dimensions": (40, 6), "two samples": (2, 5)}
both_shapes = pytest.mark.parametrize("shape", SHAPES)


def stimuli(shape: str, seed: int = 0, fill: float = 0.7) -> csr_array:
    rng = np.random.default_rng(seed)
    size = SHAPES[shape]
    return csr_array((rng.random(size) * (rng.random(size) < fill)).astype(np.float32))


def features(vectors: csr_array, power: float) -> NDArray[np.float64]:
    rows = vectors.toarray().astype(np.float64)
    if power != 1:  # raw vectors
        rows = (rows / np.maximum(rows.sum(axis=1, keepdims=True), 1e-300)) ** power
    return rows


def squared(metric: Metric, queries: csr_array, prototypes: csr_array) -> NDArray[np.float64]:
    """As the engine measures: from queries, which may be anything, to prototypes, from which the metric was learnt."""
    between = metric.embed(queries)[:, None] - metric.embed(prototypes)[None]
    return (between**2).sum(axis=2) + metric.residual(queries)[:, None]


def explicit(a: NDArray[np.float64], b: NDArray[np.float64], inverse: NDArray[np.float64]) -> NDArray[np.float64]:
    difference = a[:, None] - b[None]
    return np.einsum("abi,ij,abj->ab", difference, inverse, difference)


@all_powers
@both_shapes
def test_the_identity_is_the_euclidean_distance(shape: str, power: float):
    known, asked = stimuli(shape), stimuli(shape, 1)
    metric = learn_metric(known, ResponseParams(metric="identity", power=power))
    a, b = features(asked, power), features(known, power)
    assert np.allclose(squared(metric, asked, known), explicit(a, b, np.eye(a.shape[1])), rtol=1e-4, atol=1e-5)


@all_powers
@pytest.mark.parametrize("shape", list(SHAPES)[:2])
def test_the_diagonal_divides_by_each_variance(shape: str, power: float):
    known, asked = stimuli(shape), stimuli(shape, 1)
    metric = learn_metric(known, ResponseParams(metric="diagonal", power=power))
    a, b = features(asked, power), features(known, power)
    expected = explicit(a, b, np.diag(1 / b.var(axis=0)))
    assert np.allclose(squared(metric, asked, known), expected, rtol=1e-3, atol=1e-3)


@all_powers
@pytest.mark.parametrize("shape", list(SHAPES)[:2])
def test_the_shrunk_covariance_is_that_of_ledoit_and_wolf(shape: str, power: float):
    known, asked = stimuli(shape), stimuli(shape, 1)
    metric = learn_metric(known, ResponseParams(metric="shrunk", power=power))
    a, b = features(asked, power), features(known, power)
    inverse = np.linalg.inv(LedoitWolf().fit(b).covariance_)
    assert np.allclose(squared(metric, asked, known), explicit(a, b, inverse), rtol=1e-4)


@all_powers
@pytest.mark.parametrize(("shape", "dimensions"), [*((s, k) for s in list(SHAPES)[:2] for k in (1, 3, 5))])
def test_the_subspace_is_that_of_the_strongest_components(shape: str, dimensions: int, power: float):
    known, asked = stimuli(shape), stimuli(shape, 1)
    metric = learn_metric(known, ResponseParams(metric="subspace", dimensions=dimensions, power=power))
    pca = PCA(dimensions, whiten=True, svd_solver="full").fit(features(known, power))
    a, b = (pca.transform(features(v, power)) for v in (asked, known))
    assert np.allclose(squared(metric, asked, known), ((a[:, None] - b[None]) ** 2).sum(axis=2), rtol=1e-3, atol=1e-4)


def test_the_power_of_one_half_is_the_distance_of_hellinger():
    """Half the squared distance between the roots of two distributions is 1 less their Bhattacharyya coefficient."""
    known, asked = stimuli("more dimensions than samples"), stimuli("more dimensions than samples", 1)
    metric = learn_metric(known, ResponseParams(metric="identity", power=0.5))
    p, q = (v.toarray().astype(float) / v.toarray().astype(float).sum(axis=1, keepdims=True) for v in (asked, known))
    coefficient = np.array([[np.sqrt(a * b).sum() for b in q] for a in p])
    assert np.allclose(squared(metric, asked, known) / 2, 1 - coefficient, atol=1e-5)


@pytest.mark.parametrize(("power", "keeps"), [(0.25, True), (0.5, True), (0.75, True), (1.0, False)])
def test_how_strong_stimuli_are_in_all_counts_only_where_they_are_raw(power: float, keeps: bool):
    known, asked = stimuli("more samples than dimensions"), stimuli("more samples than dimensions", 1)
    metric = learn_metric(known, ResponseParams(metric="identity", power=power))
    louder = csr_array(asked * np.float32(4))
    assert np.allclose(squared(metric, asked, known), squared(metric, louder, known), rtol=1e-6) == keeps


def test_strong_components_of_many_samples_are_found_without_all_others():
    rng = np.random.default_rng(0)
    known = csr_array((rng.random((90, 120)) * (rng.random((90, 120)) < 0.3)).astype(np.float32))
    metric = learn_metric(known, ResponseParams(metric="subspace", dimensions=5, power=1))
    pca = PCA(5, svd_solver="full").fit(known.toarray().astype(float))
    assert np.allclose(metric.variance, pca.explained_variance_, rtol=1e-6)
    assert np.allclose(np.abs(np.sum(metric.components * pca.components_, axis=1)), 1, atol=1e-5)


@pytest.mark.parametrize("kind", ["subspace", "diagonal", "shrunk", "identity"])
@all_powers
def test_components_are_orthonormal_and_their_signs_told(kind: str, power: float):
    metric = learn_metric(stimuli("more dimensions than samples"), ResponseParams(metric=kind, power=power))
    assert np.allclose(metric.components @ metric.components.T, np.eye(len(metric.components)), atol=1e-5)
    assert (metric.variance > 0).all()
    assert metric.residual_variance > 0
    largest = np.take_along_axis(metric.components, np.abs(metric.components).argmax(axis=1)[:, None], axis=1)
    assert (largest > 0).all()


@pytest.mark.parametrize("kind", ["subspace", "diagonal", "shrunk", "identity"])
@all_powers
def test_equal_samples_and_empty_ones_have_distances_of_some_size(kind: str, power: float):
    row = np.random.default_rng(0).random(6)
    for rows in ([row] * 4, [row, row, row, 0 * row], [0 * row] * 3, [row, 2 * row]):
        known = csr_array(np.array(rows, dtype=np.float32))
        metric = learn_metric(known, ResponseParams(metric=kind, power=power))
        asked = csr_array(np.array([row, 0 * row, row[::-1]], dtype=np.float32))
        assert (squared(metric, asked, known) < 1e12).all()


def test_learning_twice_gives_the_same_bits():
    for kind in ("subspace", "shrunk"):
        params = ResponseParams(metric=kind)
        a, b = (learn_metric(learnt().stimuli.copy(), params) for _ in range(2))
        assert a.components.tobytes() == b.components.tobytes()
        assert a.variance.tobytes() == b.variance.tobytes()
