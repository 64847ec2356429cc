"""The protocols: on vectors that tell all or nothing, and against the project's yardstick on real scans."""

from __future__ import annotations

import importlib.util
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from service import clouds
from service.engine.errors import InvalidParameter
from worker.evaluation.judgement import judge, judge_others, mean_figures
from worker.evaluation.labels import judged, read_labels
from worker.evaluation.measures import balanced_accuracy
from worker.evaluation.protocols import (
    Samples,
    nearest_neighbour,
    nearest_neighbour_of_others,
    require,
    support_vectors,
    support_vectors_of_others,
)

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


def test_another_set_that_is_the_same_one_is_told_as_the_first_is() -> None:
    samples = blobs(2)
    assert (nearest_neighbour_of_others(samples, samples) == nearest_neighbour(samples)).all()


def test_another_set_is_told_by_what_the_first_shows() -> None:
    others = blobs(30, np.char.add("other ", ALONE), seed=1)
    assert (nearest_neighbour_of_others(blobs(30), others) == LABELS).all()
    assert (support_vectors_of_others(blobs(30), others) == LABELS).all()


def test_clouds_of_a_group_do_not_judge_one_another_across_sets() -> None:
    groups = LABELS.copy()
    samples, others = blobs(30, groups), blobs(30, groups, seed=1)
    assert (nearest_neighbour_of_others(samples, others) != LABELS).all()
    assert (support_vectors_of_others(samples, others) != LABELS).all()


def test_too_few_groups_or_concepts_to_judge_by_are_told() -> None:
    samples = blobs(30)
    require(samples)
    with pytest.raises(InvalidParameter, match="3 groups"):
        require(blobs(30, groups=LABELS))
    with pytest.raises(InvalidParameter, match="there is 1 number"):
        require(Samples(samples.vectors[:, :1], LABELS, ALONE))
    with pytest.raises(InvalidParameter, match=r"told from the vectors 'VFH'.* the same for all"):
        require(Samples(np.ones((36, 3)), LABELS, ALONE), "the vectors 'VFH'")


@pytest.mark.data
def test_figures_are_those_of_the_yardstick(scans: Path) -> None:
    yardstick = _yardstick(scans)
    table = scans / "scans" / "labels.csv"
    samples = _samples(table, judged(read_labels(table)))
    with threadpool_limits(1):  # the map depends on the number of threads
        expected = yardstick.score(_vectors(table), *yardstick.labels(table))
    judgement = judge(samples)
    figures = mean_figures(judgement.by_label())
    assert expected == {
        "n": len(samples.labels),
        "classes": len(judgement.regions.labels),
        **{name: round(value, 3) for name, value in figures.model_dump().items()},
    }


@pytest.mark.data
def test_another_set_is_judged_as_the_yardstick_does(scans: Path) -> None:
    yardstick = _yardstick(scans)
    first, second = scans / "scans" / "labels.csv", scans / "occluded" / "labels.csv"
    samples = _samples(first, judged(read_labels(first)))
    rows = read_labels(second)
    others = _samples(second, [place for place, row in enumerate(rows) if row.category in samples.labels])
    recalls = judge_others(samples, others).intervals()
    assert yardstick.judge(
        _vectors(first), *yardstick.labels(first), _vectors(second), yardstick.labels(second)[0]
    ) == {"n": len(others.labels), "knn": round(recalls.knn.value, 3), "svm": round(recalls.svm.value, 3)}


def _yardstick(scans: Path) -> ModuleType:
    file = scans.parent / "tools" / "protocol.py"
    if not file.is_file():
        pytest.skip(f"the yardstick is not at {file}")
    spec = importlib.util.spec_from_file_location("yardstick", file)
    assert spec is not None
    assert spec.loader is not None
    yardstick = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(yardstick)
    return yardstick


@cache
def _vectors(table: Path) -> np.ndarray:
    """How long, wide and flat each cloud of a labels' file is."""
    points = [clouds.read(row.path.read_bytes(), name=row.file).points for row in read_labels(table)]
    return np.array([np.log(np.linalg.eigvalsh(np.cov(p.T.astype(float)))) for p in points])


def _samples(table: Path, places: list[int]) -> Samples:
    rows = read_labels(table)
    labels, groups = np.array([row.category for row in rows]), np.array([row.group for row in rows])
    return Samples(_vectors(table)[places], labels[places], groups[places])
