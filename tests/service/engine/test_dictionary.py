"""Visual words: the nearest of each level."""

from __future__ import annotations

import numpy as np
import pytest

from service.engine.dictionary import Dictionary


@pytest.mark.parametrize("seed", range(3))
def test_a_segment_takes_the_nearest_word_of_every_level(seed: int):
    rng = np.random.default_rng(seed)
    dictionary = Dictionary(tuple(rng.random((2**f, 5)).astype(np.float32) for f in (1, 2, 3)))
    descriptors = rng.random((20, 5)).astype(np.float32)
    words = dictionary.words(descriptors)
    assert words.shape == (20, 3)
    for s, descriptor in enumerate(descriptors.astype(float)):
        for f, level in enumerate(dictionary.levels):
            distances = [np.sqrt(sum((a - b) ** 2 for a, b in zip(descriptor, word, strict=True))) for word in level]
            assert words[s, f] == int(np.argmin(distances))


def test_of_equally_near_words_the_first_is_taken():
    same = np.full((4, 3), 0.5, np.float32)
    assert Dictionary((same[:2], same)).words(np.ones((2, 3), np.float32)).tolist() == [[0, 0], [0, 0]]


def test_a_word_finds_itself():
    words = np.random.default_rng(0).random((16, 33)).astype(np.float32)
    assert Dictionary((words,)).words(words)[:, 0].tolist() == list(range(16))
