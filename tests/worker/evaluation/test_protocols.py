"""The protocols: on vectors that tell all or nothing, and against the project's yardstick on real scans."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from service import clouds
from service.engine.errors import InvalidParameter
from worker.evaluation.labels import judged, read_labels
from worker.evaluation.measures import balanced_accuracy
from worker.evaluation.protocols import Samples, nearest_neighbour, region_matrices, require, support_vectors

LABELS = np.repeat(["ball", "box", "can"], 12)
ALONE = np.arange(36).astype(str)


def blobs(distance: float, groups: np.ndarray = ALONE, seed: int = 0) -> Samples:
    """Three labels whose vectors lie around centres at a distance from each other, in standard deviations."""
    rng = np.random.default_rng(seed)
    centres = distance * np.eye(3).repeat(12, axis=0)
    return Samples(centres + rng.normal(size=(36, 3)), LABELS, groups)


def test_vectors_that_tell_labels_apart_are_found_to() -> None:
    samples = blobs(30)
    assert (nearest_neighbour(samples) == LABELS).all()
    assert (support_vectors(samples) == LABELS).all()


def test_vectors_that_tell_nothing_are_near_chance() -> None:
    drawn = [blobs(0, seed=seed) for seed in range(10)]
    nearest = [balanced_accuracy(LABELS, nearest_neighbour(samples)) for samples in drawn]
    machines = [balanced_accuracy(LABELS, p) for samples in drawn for p in support_vectors(samples)]
    assert 0.2 < np.mean(nearest) < 0.47
    assert 0.2 < np.mean(machines) < 0.47


def test_a_neighbour_of_the_same_group_is_none() -> None:
    samples = blobs(30, groups=LABELS)  # all of a label are one group: every neighbour is of another label
    assert (nearest_neighbour(samples) != LABELS).all()


def test_a_label_of_a_single_group_is_asked_for_and_never_taught() -> None:
    groups = np.where(LABELS == "ball", "the only one", ALONE)
    predicted = support_vectors(blobs(30, groups))
    assert (predicted[:, LABELS == "ball"] != "ball").all()
    assert (predicted[:, LABELS != "ball"] == LABELS[LABELS != "ball"]).all()


def test_two_labels_of_which_one_is_a_single_group_can_be_split() -> None:
    two = LABELS != "can"
    groups = np.where(LABELS == "ball", "the only one", ALONE)[two]
    assert support_vectors(Samples(blobs(30).vectors[two], LABELS[two], groups)).shape == (5, 24)


def test_rows_of_the_matrices_are_shares() -> None:
    regions = region_matrices(blobs(3))
    assert regions.labels == ("ball", "box", "can")
    assert regions.assigned.sum(axis=1) == pytest.approx([1, 1, 1])
    assert (regions.within >= 0).all()
    assert (regions.within.sum(axis=1) <= 1 + 1e-12).all()


def test_too_few_groups_or_concepts_to_judge_by_are_told() -> None:
    samples = blobs(30)
    require(samples)
    with pytest.raises(InvalidParameter, match="3 groups"):
        require(blobs(30, groups=LABELS))
    with pytest.raises(InvalidParameter, match="1 concepts"):
        require(Samples(samples.vectors[:, :1], LABELS, ALONE))
    with pytest.raises(InvalidParameter, match="the same for all"):
        require(Samples(np.ones((36, 3)), LABELS, ALONE))


@pytest.mark.data
def test_figures_are_those_of_the_yardstick(scans: Path) -> None:
    file = scans.parent / "tools" / "protocol.py"
    if not file.is_file():
        pytest.skip(f"the yardstick is not at {file}")
    spec = importlib.util.spec_from_file_location("yardstick", file)
    assert spec is not None
    assert spec.loader is not None
    yardstick = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(yardstick)
    table = scans / "scans" / "labels.csv"
    labelled = read_labels(table)
    points = [clouds.read(cloud.path.read_bytes(), name=cloud.file).points for cloud in labelled]
    vectors = np.array([np.log(np.linalg.eigvalsh(np.cov(p.T.astype(float)))) for p in points])
    expected = yardstick.score(vectors, *yardstick.labels(table))

    kept = judged(labelled)
    samples = Samples(
        vectors[kept],
        np.array([labelled[place].category for place in kept]),
        np.array([labelled[place].group for place in kept]),
    )
    regions = region_matrices(samples)
    assert expected == {
        "n": len(kept),
        "classes": len(regions.labels),
        "knn": round(balanced_accuracy(samples.labels, nearest_neighbour(samples)), 3),
        "svm": round(float(np.mean([balanced_accuracy(samples.labels, p) for p in support_vectors(samples)])), 3),
        "within": round(float(np.diag(regions.within).mean()), 3),
        "assigned": round(float(np.diag(regions.assigned).mean()), 3),
    }
