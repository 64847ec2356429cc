"""The map by all pairs: its affinities, and how well it keeps them, against scikit-learn's exact t-SNE."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from sklearn.manifold import TSNE

from worker.learning.embedding import _slope, affinities, embed


def groups(count: int = 4, each: int = 30, seed: int = 0) -> NDArray[np.float64]:
    rng = np.random.default_rng(seed)
    return np.repeat(6 * rng.standard_normal((count, 8)), each, axis=0) + rng.standard_normal((count * each, 8))


def divergence(affinity: NDArray[np.float64], place: NDArray[np.float64]) -> float:
    """What t-SNE makes small: KL(P | Q), nats."""
    kernel = 1 / (1 + ((place[:, None] - place[None]) ** 2).sum(axis=2))
    np.fill_diagonal(kernel, 0)
    kernel /= kernel.sum()
    there = affinity > 0
    return float((affinity[there] * np.log(affinity[there] / kernel[there])).sum())


@pytest.mark.parametrize("perplexity", [2.0, 10.0, 30.0])
def test_affinities_are_symmetric_sum_to_one_and_have_the_perplexity(perplexity: float):
    found = affinities(groups(), perplexity).toarray()
    assert np.allclose(found, found.T)
    assert found.sum() == pytest.approx(1)
    assert not np.diag(found).any()
    alone = np.zeros((20, 1))
    alone[:, 0] = np.linspace(0, 1, 20)
    shares = affinities(alone, perplexity=5).toarray()
    assert np.argmax(shares[0]) == 1


def test_the_slope_is_that_of_the_divergence():
    """Against finite differences."""
    rng = np.random.default_rng(1)
    affinity, place = affinities(groups(2, 10), 5), rng.standard_normal((20, 2))
    slope, small = np.empty((20, 2)), 1e-6
    _slope(affinity.indptr, affinity.indices, affinity.data, place[:, 0].copy(), place[:, 1].copy(), 1.0, slope)
    dense = affinity.toarray()
    for i in range(20):
        for axis in range(2):
            there, back = place.copy(), place.copy()
            there[i, axis] += small
            back[i, axis] -= small
            rise = (divergence(dense, there) - divergence(dense, back)) / (2 * small)
            assert slope[i, axis] == pytest.approx(rise, abs=1e-6)


def test_a_map_keeps_affinities_as_well_as_scikit_learns():
    ours, theirs = [], []
    for seed in range(4):
        coordinates = groups(seed=seed)
        start = 1e-4 * coordinates[:, :2] / coordinates[:, 0].std()
        affinity = affinities(coordinates, 20).toarray()
        ours.append(divergence(affinity, embed(coordinates, 20, start)))
        theirs.append(
            divergence(
                affinity, TSNE(2, perplexity=20, init=start, method="exact", n_jobs=1).fit_transform(coordinates)
            )
        )
    assert np.mean(ours) < 1.05 * np.mean(theirs)


@pytest.mark.parametrize("coordinates", [np.zeros((9, 3)), np.ones((4, 1)), np.repeat(groups(2, 1), 20, axis=0)])
def test_objects_that_are_all_alike_have_places(coordinates: NDArray[np.float64]):
    place = embed(coordinates, min(30, (len(coordinates) - 1) / 3), np.zeros((len(coordinates), 2)))
    assert np.isfinite(place).all()
