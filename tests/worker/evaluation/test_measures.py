"""The measures, on concepts whose figures can be counted on one's fingers."""

from __future__ import annotations

import numpy as np
import pytest

from worker.evaluation.measures import balanced_accuracy, label_counts, pure_share, purity, rank_score, recalls

CONCEPTS = [0, 0, 0, 0, 1, 1, -1, 2, 2, 2]
LABELS = ["box", "box", "can", "box", "can", "can", "box", "can", "box", "stone"]


def counts() -> np.ndarray:
    return label_counts(CONCEPTS, LABELS, ["box", "can"])


def test_prototypes_outside_every_concept_and_foreign_labels_are_counted_nowhere() -> None:
    assert counts().tolist() == [[3, 1], [0, 2], [1, 1]]


def test_purity_is_the_largest_share_of_one_category() -> None:
    assert purity(counts(), [4, 2, 3]) == pytest.approx([3 / 4, 1, 1 / 3])


def test_without_concepts_there_is_nothing_to_count() -> None:
    assert label_counts([-1, -1], ["box", "can"], ["box", "can"]).shape == (0, 2)


def test_rank_score_is_equation_6() -> None:
    assert rank_score([0.75, 1.0], [4, 2], epsilon=0.01) == pytest.approx([4 / 0.26, 2 / 0.01])


def test_of_equally_pure_concepts_the_larger_ranks_higher_and_of_equally_large_ones_the_purer() -> None:
    assert rank_score([0.5], [7]) > rank_score([0.5], [6])
    assert rank_score([0.6], [6]) > rank_score([0.5], [6])


def test_share_of_pure_concepts() -> None:
    assert pure_share(purity(counts(), [4, 2, 3])) == pytest.approx(1 / 3)


def test_balanced_accuracy_counts_each_label_alike() -> None:
    labels = np.array(["box"] * 8 + ["can"] * 2)
    predicted = np.array(["box"] * 10)
    assert recalls(labels, predicted) == {"box": 1.0, "can": 0.0}
    assert balanced_accuracy(labels, predicted) == 0.5
