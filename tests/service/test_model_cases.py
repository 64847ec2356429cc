"""The use cases on models, as every transport calls them."""

from __future__ import annotations

from pathlib import Path

import pytest

from service.application import Application
from service.engine.errors import InvalidParameter, ModelNotFound
from service.engine.model import ShapeModel
from service.model_file import decode, read_manifest


def test_a_promotion_and_a_rollback_take_effect_at_once(application: Application, model: ShapeModel) -> None:
    application.store.publish(model, name="tiny", seed=7, source={})
    assert application.which("tiny") == ("tiny", 2)
    assert application.models.rollback("tiny") == 1
    assert application.which("tiny") == ("tiny", 1)
    assert application.models.promote("tiny:2") == ("tiny", 2)
    assert application.which("tiny") == ("tiny", 2)
    (summary,) = application.models.all()
    assert (summary.name, summary.versions, summary.aliases) == ("tiny", [1, 2], {"production": 2})


def test_all_that_an_alias_meant_is_told_oldest_first(application: Application, model: ShapeModel) -> None:
    for _ in range(2):
        application.store.publish(model, name="tiny", seed=7, source={})
    application.models.rollback("tiny")
    (entries,) = application.models.histories("tiny").values()
    assert [entry.version for entry in entries] == [1, 2, 3, 2]
    with pytest.raises(ModelNotFound):
        application.models.histories("other")


def test_a_version_that_is_written_out_is_the_one_that_answers(
    application: Application, model: ShapeModel, tmp_path: Path
) -> None:
    manifest, tensors = application.models.export("tiny", 1, tmp_path)
    assert read_manifest(manifest.read_bytes()) == application.models.manifest("tiny", 1)
    assert decode(tensors.read_bytes(), application.models.manifest("tiny", 1)).params == model.params


def test_concepts_are_those_of_the_time_that_is_asked_for(application: Application, model: ShapeModel) -> None:
    listed = application.models.concepts("tiny", 1, 1.0)
    assert [concept.id for concept in listed.concepts] == model.spectrum(1.0).ids.tolist()
    with pytest.raises(InvalidParameter):
        application.models.concepts("tiny", 1, 1.5)
