"""Learning visual words by halving."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from service.engine.dictionary import Dictionary
from service.engine.params import DictionaryParams
from tests.learnt import learnt, perceived
from worker.learning.dictionary import learn_dictionary


def blobs(seed: int = 0, each: int = 30) -> NDArray[np.float32]:
    """Four clouds of points: two near each other, and two near each other far from these."""
    rng = np.random.default_rng(seed)
    centres = np.array([[0, 0, 0], [0, 1, 0], [10, 0, 0], [10, 1, 1]])
    return np.concatenate([c + 0.05 * rng.standard_normal((each, 3)) for c in centres]).astype(np.float32)


def learn(descriptors: NDArray[np.float32], levels: int = 4) -> Dictionary:
    return learn_dictionary(descriptors, DictionaryParams(levels=levels))


@pytest.mark.parametrize("count", [1, 2, 3, 17, 120])
@pytest.mark.parametrize("levels", [1, 4, 6])
def test_level_f_has_two_to_the_f_words(count: int, levels: int):
    dictionary = learn(blobs()[:count], levels)
    assert [len(level) for level in dictionary.levels] == [2**f for f in range(1, levels + 1)]
    assert all(level.dtype == np.float32 and np.isfinite(level).all() for level in dictionary.levels)


def test_a_level_finds_the_groups_that_are_there():
    descriptors = blobs()
    words = learn(descriptors, 2).words(descriptors).reshape(4, 30, 2)
    assert (words == words[:, :1]).all()  # one word a group on both levels
    coarse, fine = words[:, 0, 0], words[:, 0, 1]
    assert coarse[0] == coarse[1] != coarse[2] == coarse[3]
    assert len(set(fine.tolist())) == 4
    assert (fine // 2 == coarse).all()


def test_the_finest_words_are_means_of_clusters():
    descriptors = blobs()
    level = learn(descriptors, 2).levels[1]
    means = descriptors.reshape(4, 30, 3).mean(axis=1)
    assert np.allclose(sorted(level.tolist()), sorted(means.tolist()), atol=1e-5)


def check_refines(dictionary: Dictionary, rest: NDArray[np.float32]) -> None:
    """A word is the mean of the cluster that its two halves make up, so it lies on the line between their means."""
    parents = [rest.mean(axis=0, keepdims=True), *dictionary.levels[:-1]]
    for parent, children in zip(parents, dictionary.levels, strict=True):
        for word, (a, b) in zip(parent.astype(float), children.astype(float).reshape(len(parent), 2, -1), strict=True):
            between = (word - a) @ (b - a) / max((b - a) @ (b - a), 1e-30)
            assert -1e-4 <= between <= 1 + 1e-4
            assert np.allclose(a + between * (b - a), word, atol=1e-5)


def test_each_level_refines_the_one_before():
    descriptors = np.random.default_rng(1).random((200, 5)).astype(np.float32)
    check_refines(learn(descriptors, 5), descriptors)
    segments = np.concatenate([p.segment_descriptors for p in perceived()])
    check_refines(learn(segments), segments)


def spread(descriptors: NDArray[np.float32], level: NDArray[np.float32]) -> float:
    return float(((descriptors[:, None] - level[None]) ** 2).sum(axis=2).min(axis=1).mean())


def test_finer_levels_are_nearer():
    segments = np.concatenate([p.segment_descriptors for p in perceived()])
    spreads = [spread(segments, level) for level in learn(segments, 5).levels]
    assert spreads == sorted(spreads, reverse=True)
    assert spreads[-1] < 0.7 * spreads[0]


def test_duplicates_and_a_single_segment_have_words_all_the_same():
    same = np.tile(np.float32([0.2, 0.3, 0.5]), (9, 1))
    for descriptors in (same, same[:1]):
        for level in learn(descriptors, 3).levels:
            assert np.array_equal(level, np.tile(same[0], (len(level), 1)))
    two = np.concatenate([same, same + np.float32(0.1)])
    for level in learn(two, 3).levels:
        assert {tuple(word) for word in level.tolist()} == {tuple(row) for row in two.tolist()}


def test_learning_twice_gives_the_same_bits():
    segments = np.concatenate([p.segment_descriptors for p in perceived()])
    for a, b in zip(learn(segments).levels, learn(segments.copy()).levels, strict=True):
        assert a.tobytes() == b.tobytes()


def test_the_order_of_the_segments_moves_words_by_rounding_alone():
    descriptors = blobs(3)
    shuffled = np.random.default_rng(0).permutation(descriptors)
    for a, b in zip(learn(descriptors, 3).levels, learn(shuffled, 3).levels, strict=True):
        assert np.allclose(a, b, atol=1e-5)


@pytest.mark.parametrize("preset", ["default", "paper"])
def test_a_models_words_are_those_of_its_segments(preset: str):
    model = learnt(preset)
    segments = np.concatenate([p.segment_descriptors for p in perceived(preset)])
    again = learn(segments, model.params.dictionary.levels)
    for ours, theirs in zip(model.dictionary.levels, again.levels, strict=True):
        assert np.array_equal(ours, theirs)
