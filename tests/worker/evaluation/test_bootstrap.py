"""Bootstrap intervals, where what they must be is known."""

from __future__ import annotations

import numpy as np
import pytest

from worker.evaluation.bootstrap import difference, mean_recall
from worker.evaluation.measures import balanced_accuracy

COUNT = 400
LABELS = np.tile(["box", "can"], COUNT // 2)
ALONE = np.array([f"scene {place}" for place in range(COUNT)])


def guesses(right: float, seed: int = 0) -> np.ndarray:
    """Labels of which a share is right."""
    other = np.where(LABELS == "box", "can", "box")
    return np.where(np.random.default_rng(seed).random(COUNT) < right, LABELS, other)


def test_the_figure_is_the_mean_recall_and_lies_in_its_interval() -> None:
    predicted = guesses(0.8)
    estimate = mean_recall(LABELS, ALONE, predicted)
    assert estimate.value == pytest.approx(balanced_accuracy(LABELS, predicted))
    assert estimate.low < estimate.value < estimate.high


def test_repetitions_are_averaged() -> None:
    repeated = np.stack([guesses(0.6, seed) for seed in range(3)])
    expected = np.mean([balanced_accuracy(LABELS, predicted) for predicted in repeated])
    assert mean_recall(LABELS, ALONE, repeated).value == pytest.approx(expected)


def test_an_interval_is_as_wide_as_the_binomial_distribution_says() -> None:
    estimate = mean_recall(LABELS, ALONE, guesses(0.7))
    width = 2 * 1.96 * np.sqrt(estimate.value * (1 - estimate.value) / COUNT)
    assert estimate.high - estimate.low == pytest.approx(width, rel=0.15)


def test_more_clouds_of_the_same_groups_tell_nothing_more() -> None:
    predicted = guesses(0.7)
    once = mean_recall(LABELS, ALONE, predicted)
    often = mean_recall(LABELS.repeat(9), ALONE.repeat(9), predicted.repeat(9))
    assert often == pytest.approx(once)


def test_clouds_of_one_group_stand_and_fall_together() -> None:
    predicted = guesses(0.7)
    scenes = np.arange(COUNT) // 40
    few = mean_recall(LABELS, scenes.astype(str), np.where(scenes % 2 == 0, LABELS, "none"))
    many = mean_recall(LABELS, ALONE, predicted)
    assert few.high - few.low > 3 * (many.high - many.low)


def test_without_errors_there_is_no_doubt() -> None:
    assert mean_recall(LABELS, ALONE, LABELS) == (1, 1, 1)


def test_equal_predictions_do_not_differ() -> None:
    assert difference(LABELS, ALONE, guesses(0.7), guesses(0.7)) == (0, 0, 0)


def test_a_difference_turned_round_changes_its_sign() -> None:
    there = difference(LABELS, ALONE, guesses(0.9), guesses(0.6, 1))
    back = difference(LABELS, ALONE, guesses(0.6, 1), guesses(0.9))
    assert (there.value, there.low, there.high) == pytest.approx((-back.value, -back.high, -back.low))
    assert there.low > 0


def test_a_paired_difference_is_surer_than_the_two_figures() -> None:
    first = guesses(0.7)
    second = np.where(np.arange(COUNT) < 20, "none", first)
    apart = difference(LABELS, ALONE, first, second)
    alone = mean_recall(LABELS, ALONE, first)
    assert apart.high - apart.low < 0.5 * (alone.high - alone.low)


def test_a_label_that_no_drawn_group_has_is_left_out() -> None:
    labels = np.array(["box", "box", "can"])
    estimate = mean_recall(labels, np.array(["a", "b", "c"]), np.array(["box", "box", "box"]))
    assert estimate.value == 0.5
    assert (estimate.low, estimate.high) == (0, 1)  # draws of "c" alone, and draws without it
