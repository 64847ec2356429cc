"""Every cloud is answered once, or refused with its reason."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from service.clouds import write_ply
from service.engine.errors import ShapeConceptsError
from tests.learnt import learnt, objects
from worker.evaluation.answering import AnsweredSet, answer
from worker.evaluation.labels import LabelledCloud
from worker.evaluation.robustness import DISTURBANCES, REFUSED


@pytest.fixture(scope="module")
def answered(tmp_path_factory: pytest.TempPathFactory) -> AnsweredSet:
    """Three clouds that a model was learnt from, one that is empty and one that is not there."""
    folder = tmp_path_factory.mktemp("clouds")
    for simulated in objects()[:3]:
        (folder / f"{simulated.index}.ply").write_bytes(write_ply(simulated.cloud))
    (folder / "empty.ply").touch()
    files = ["0.ply", "empty.ply", "1.ply", "lost.ply", "2.ply"]
    rows = [LabelledCloud(file, folder / file, "box", file, "") for file in files]
    return answer(learnt(), folder / "labels.csv", rows, disturb=True, count=lambda items, total: items)


def test_answers_and_refusals_stand_in_the_order_of_the_rows(answered: AnsweredSet) -> None:
    assert [each.cloud.file for each in answered.answered] == ["0.ply", "1.ply", "2.ply"]
    assert [each.cloud.file for each in answered.refused] == ["empty.ply", "lost.ply"]
    assert all(isinstance(each.error, ShapeConceptsError) for each in answered.refused)
    assert "No such file" in str(answered.refused[1].error)


def test_an_answer_is_what_the_model_says(answered: AnsweredSet) -> None:
    model = learnt()
    for each, simulated in zip(answered.answered, objects(), strict=False):
        response = model.respond(simulated.cloud)
        assert each.responses == pytest.approx(response.responses)
        assert each.best == response.concept_ids[response.ranking[0]]
        assert each.seen.digest in model.prototypes.cloud_hashes


def test_every_strength_of_every_disturbance_has_a_best_concept_or_is_refused(answered: AnsweredSet) -> None:
    strengths = sum(len(each.strengths) for each in DISTURBANCES)
    known = set(learnt().concepts().ids.tolist())
    for each in answered.answered:
        assert each.disturbed.shape == (strengths,)
        assert set(each.disturbed.tolist()) <= known | {REFUSED}  # of few points a tenth is too few


def test_who_waits_is_told_of_every_cloud(tmp_path: Path) -> None:
    counted: list[int] = []

    def count(items: Iterable[Any], total: int) -> Iterable[Any]:
        counted.append(total)
        return items

    rows = [LabelledCloud(file, tmp_path / file, "box", file, "") for file in ("a.ply", "b.ply")]
    told = answer(learnt(), tmp_path / "labels.csv", rows, disturb=False, count=count)
    assert counted == [2]
    assert len(told.refused) == 2
    assert np.shape(told.answered) == (0,)
