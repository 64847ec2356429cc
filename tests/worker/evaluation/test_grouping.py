"""Concepts against labels, and against plain clusterings of the same prototypes."""

from __future__ import annotations

import numpy as np
import pytest

from service.engine.concepts import Concepts
from tests.learnt import learnt
from worker.evaluation.grouping import LabelledPrototypes, group_figures, judge_grouping, labelled_prototypes

LABELS = ("box",) * 8 + ("can",) * 8 + ("ball",) * 8
TRUE = np.repeat([0, 1, 2], 8)


def known(assignment: np.ndarray, labels: tuple[str, ...] = LABELS) -> LabelledPrototypes:
    sizes = np.bincount(assignment[assignment >= 0])
    concepts = Concepts(0.5, 100 + np.arange(len(sizes)), sizes, assignment)
    return LabelledPrototypes(tuple(map(str, range(len(labels)))), labels, assignment, ("ball", "box", "can"), concepts)


def test_groups_that_are_the_labels_have_full_marks() -> None:
    figures = group_figures(TRUE, known(TRUE))
    assert figures.groups == 3
    assert set(figures.model_dump(exclude={"groups"}).values()) == {1.0}


def test_one_group_of_everything_tells_nothing() -> None:
    figures = group_figures(0 * TRUE, known(0 * TRUE))
    assert (figures.purity, figures.pure, figures.covered) == (pytest.approx(1 / 3), 0, 1)
    assert (figures.v_measure, figures.adjusted_rand) == (pytest.approx(0), pytest.approx(0))


def test_numbers_of_groups_mean_nothing() -> None:
    mixed = np.random.default_rng(0).integers(0, 4, len(TRUE))
    turned = group_figures(3 - mixed, known(3 - mixed))
    assert turned.model_dump() == pytest.approx(group_figures(mixed, known(mixed)).model_dump())


def test_what_is_not_covered_costs_only_where_all_prototypes_count() -> None:
    partly = np.where(np.arange(24) % 8 < 5, TRUE, -1)
    figures = group_figures(partly, known(partly))
    assert figures.covered == pytest.approx(15 / 24)
    assert (figures.v_measure_covered, figures.adjusted_rand_covered) == (1, 1)
    assert figures.v_measure < 1
    assert figures.adjusted_rand < 1
    assert (figures.purity, figures.pure) == (1, 1)


def test_a_rival_is_asked_for_what_the_concepts_cover() -> None:
    partly = np.where(np.arange(24) % 8 < 5, TRUE, -1)
    wrong_outside = np.where(partly < 0, 0, TRUE)
    figures = group_figures(wrong_outside, known(partly))
    assert figures.adjusted_rand_covered == 1
    assert figures.adjusted_rand < 1


def test_other_agrees_with_nothing_not_even_with_other() -> None:
    labels = LABELS[:16] + ("other",) * 8
    figures = group_figures(TRUE, known(TRUE, labels))
    assert figures.purity == pytest.approx(2 / 3)
    assert figures.v_measure < 1
    assert figures.adjusted_rand < 1


def test_clusterings_of_vectors_that_tell_labels_apart_find_them() -> None:
    vectors = 50 * np.eye(3)[TRUE] + np.random.default_rng(1).normal(size=(24, 3))
    grouping = judge_grouping(known(TRUE), {"clear": vectors})
    assert {(rival.vectors, rival.method) for rival in grouping.rivals} == {("clear", "k-means"), ("clear", "HDBSCAN")}
    for rival in grouping.rivals:
        assert rival.figures.groups == 3
        assert rival.figures.adjusted_rand > 0.7
    assert grouping.rivals[0].figures.adjusted_rand == 1


def test_clusterings_have_as_many_groups_as_there_are_concepts_or_nearly() -> None:
    vectors = np.random.default_rng(2).normal(size=(24, 4))
    assignment = np.arange(24) % 5
    kmeans, *dense = judge_grouping(known(assignment), {"noise": vectors}).rivals
    assert kmeans.figures.groups == 5
    assert kmeans.setting == "k = 5"
    assert kmeans.runs > 1
    assert abs(kmeans.figures.adjusted_rand) < 0.3
    assert all(rival.figures.groups < 12 for rival in dense)


def test_vectors_that_are_all_alike_cannot_be_clustered() -> None:
    assert judge_grouping(known(TRUE), {"flat": np.ones((24, 3))}).rivals == []


def test_concepts_are_ranked_and_say_what_they_hold() -> None:
    assignment = np.where(np.arange(24) == 8, 0, np.where(TRUE == 2, -1, TRUE))  # a can among the boxes, no balls
    grouping = judge_grouping(known(assignment), {})
    assert [(c.id, c.label, c.labels) for c in grouping.concepts] == [
        (101, "can", {"can": 7}),
        (100, "box", {"box": 8, "can": 1}),
    ]
    assert grouping.covered == pytest.approx(16 / 24)
    assert grouping.figures is not None
    assert grouping.figures.purity == grouping.purity == pytest.approx((1 + 8 / 9) / 2)


def test_prototypes_are_known_by_the_hashes_of_their_clouds() -> None:
    model = learnt()
    hashes = model.prototypes.cloud_hashes
    found = labelled_prototypes(model, dict.fromkeys(hashes[3:], "box"), ["box"])
    assert found is not None
    assert found.digests == hashes[3:]
    assert (found.assignment == model.concepts().assignment[3:]).all()
    assert labelled_prototypes(model, {"another": "box"}, ["box"]) is None
