"""One instance a label: what is drawn, who is asked, and that solids are told apart."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from service.engine.params import ModelParams
from service.engine.perception import perceive
from tests.learnt import learnt
from tests.shapes import ball, box, can, corner_view, lid_view, see
from worker.evaluation.one_instance import DRAWS, draw_instances, transfer
from worker.evaluation.report import Transfer
from worker.learning.observations import Observation

EACH = 5
LABELS = np.repeat(["ball", "box", "can"], EACH)
ALONE = np.arange(3 * EACH).astype(str)


@cache
def solids() -> tuple[Observation, ...]:
    """Lone solids of several sizes, from several sides."""
    solids = [ball(0.03 + 0.01 * seed) for seed in range(EACH)]
    solids += [box(0.1, 0.08 + 0.01 * seed, 0.12) for seed in range(EACH)]
    solids += [can(0.04, 0.08 + 0.01 * seed) for seed in range(EACH)]
    views = [(lid_view if place >= 2 * EACH else corner_view)(place, 0.8) for place in range(len(solids))]
    seen = [perceive(see(s, view).cloud, ModelParams()) for s, view in zip(solids, views, strict=True)]
    nothing = np.zeros((48, 48), np.uint8)
    return tuple(Observation("", "", each.constellations, each.descriptors, nothing) for each in seen)


def taught(labels: np.ndarray = LABELS, groups: np.ndarray = ALONE) -> Transfer | None:
    vectors = {"label": np.eye(3)[np.unique(LABELS, return_inverse=True)[1]], "nothing": np.ones((3 * EACH, 2))}
    return transfer(solids(), labels, groups, learnt().dictionary, vectors)


def test_each_draw_takes_one_instance_of_each_label_and_takes_all_alike() -> None:
    labels = np.array(["can", "box", "box", "can", "ball", "box"])
    drawn = draw_instances(labels)
    assert drawn.shape == (DRAWS, 3)
    assert (labels[drawn] == ["ball", "box", "can"]).all()
    of_boxes = np.bincount(drawn[:, 1], minlength=6)[[1, 2, 5]] / DRAWS
    assert of_boxes == pytest.approx([1 / 3] * 3, abs=0.1)


def test_solids_are_told_apart_by_one_instance_of_each() -> None:
    found = taught()
    assert found is not None
    assert found.draws == DRAWS
    assert found.recall.mean > 0.6
    assert found.recall.low <= found.recall.mean <= found.recall.high
    assert set(found.by_label) == set(LABELS)
    assert np.mean([spread.mean for spread in found.by_label.values()]) == pytest.approx(found.recall.mean)


def test_labels_that_mean_nothing_are_told_by_chance() -> None:
    mixed = np.tile(["ball", "box", "can"], EACH)
    found = taught(labels=mixed)
    assert found is not None
    assert 0.1 < found.recall.mean < 0.5


def test_vectors_are_tried_on_the_same_draws() -> None:
    found = taught()
    assert found is not None
    assert (found.rivals["label"].mean, found.rivals["label"].deviation) == (1, 0)
    assert found.rivals["nothing"].mean == pytest.approx(1 / 3)  # of equal distances the first label wins


def test_clouds_of_a_group_that_was_drawn_from_are_not_asked_for() -> None:
    found = taught(groups=LABELS)  # every draw takes of all three groups
    assert found is None
    pairs = np.where(LABELS == "ball", "balls", ALONE)
    found = taught(groups=pairs)
    assert found is not None
    assert set(found.by_label) == {"box", "can"}
