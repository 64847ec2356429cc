"""From labelled vectors to figures: what must hold between them."""

from __future__ import annotations

import numpy as np
import pytest

from worker.evaluation.judgement import judge, judge_others, mean_figures
from worker.evaluation.measures import balanced_accuracy
from worker.evaluation.protocols import Samples

LABELS = np.repeat(["ball", "box", "can"], 12)
ALONE = np.arange(36).astype(str)


def samples(distance: float, seed: int = 0, groups: np.ndarray = ALONE) -> Samples:
    centres = distance * np.eye(3).repeat(12, axis=0)
    return Samples(centres + np.random.default_rng(seed).normal(size=(36, 3)), LABELS, groups)


def test_figures_of_labels_and_their_means_are_those_of_the_predictions() -> None:
    judgement = judge(samples(2))
    by_label = judgement.by_label()
    assert list(by_label) == ["ball", "box", "can"]
    means, recalled = mean_figures(by_label), judgement.recalled
    assert means.knn == pytest.approx(balanced_accuracy(LABELS, recalled.nearest))
    assert means.svm == pytest.approx(np.mean([balanced_accuracy(LABELS, each) for each in recalled.machines]))
    assert means.within == pytest.approx(np.diag(judgement.regions.within).mean())
    assert means.assigned == pytest.approx(np.diag(judgement.regions.assigned).mean())
    assert (recalled.intervals().knn.value, recalled.intervals().svm.value) == pytest.approx((means.knn, means.svm))


def test_vectors_that_tell_more_are_ahead_of_those_that_tell_less() -> None:
    clear, blurred = judge(samples(30)).recalled, judge(samples(0.5, 1)).recalled
    ahead = clear.ahead_of(blurred)
    assert ahead.knn.low > 0
    assert ahead.svm.low > 0
    assert clear.ahead_of(clear).knn.model_dump() == {"value": 0, "low": 0, "high": 0}


def test_a_judgement_is_the_same_every_time() -> None:
    first, again = judge(samples(2)), judge(samples(2))
    assert (first.map == again.map).all()
    assert (first.recalled.machines == again.recalled.machines).all()


def test_another_set_has_figures_of_its_own() -> None:
    recalled = judge_others(samples(30), samples(30, 1, np.char.add("other ", ALONE)))
    assert recalled.by_label() == {label: {"knn": 1, "svm": 1} for label in ("ball", "box", "can")}
    assert recalled.intervals().svm.low == 1
