"""The use cases, as every transport calls them."""

from __future__ import annotations

import json
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from service.answer import Answer
from service.application import Application, CloudFile, parse_viewpoint
from service.clouds import write_ply
from service.engine.cloud import PointCloud
from service.engine.errors import (
    Cancelled,
    InvalidParameter,
    ModelDamaged,
    ModelNotFound,
    TooFewPoints,
    TooManyPoints,
)
from service.engine.model import ShapeModel
from service.settings import Settings
from service.store import ModelStore


def without_timings(answer: Answer) -> dict[str, object]:
    return answer.model_dump(exclude={"timings_ms"})


def test_an_answer_says_what_the_engine_said(
    application: Application, model: ShapeModel, clouds: list[PointCloud]
) -> None:
    response = model.respond(clouds[3])
    answer = application.respond(clouds[3])
    assert (answer.model, answer.version) == ("tiny", 1)
    assert answer.responses == response.responses.tolist()
    assert answer.distances == response.distances.tolist()
    assert [concept.id for concept in answer.concepts] == response.concept_ids[response.ranking].tolist()
    assert [concept.rank for concept in answer.concepts] == list(range(1, len(answer.responses) + 1))
    for told, said in (("response", response.responses), ("time", response.concept_times)):
        assert [getattr(concept, told) for concept in answer.concepts] == said[response.ranking].tolist()
    assert answer.novelty == response.novelty
    assert answer.stimuli is None


def test_floats_survive_json_to_the_last_bit(application: Application, clouds: list[PointCloud]) -> None:
    answer = application.respond(clouds[0], stimuli=True)
    assert Answer.model_validate_json(answer.model_dump_json()) == answer
    assert Answer.model_validate(json.loads(json.dumps(answer.model_dump()))) == answer
    assert answer.stimuli is not None
    value = np.array(answer.stimuli.value)
    np.testing.assert_array_equal(value, value.astype(np.float32))
    assert answer.stimuli.index == sorted(set(answer.stimuli.index))


def test_a_file_and_its_points_are_answered_alike(application: Application, clouds: list[PointCloud]) -> None:
    cloud = clouds[1]
    sent = application.respond(CloudFile(write_ply(cloud), name="x.ply"))
    assert without_timings(sent) == without_timings(application.respond(cloud))
    millimetres = PointCloud(cloud.points * np.float32(1000))
    in_mm = application.respond(CloudFile(write_ply(millimetres), unit="mm"))
    assert in_mm.extent_m == pytest.approx(sent.extent_m, rel=1e-4)


def test_every_stage_is_timed_and_told(application: Application, clouds: list[PointCloud]) -> None:
    told: list[str] = []
    answer = application.respond(clouds[0], on_stage=told.append)
    assert list(answer.timings_ms) == list(dict.fromkeys(told))
    assert told[0] == "decode"
    assert {"normalise", "patches", "segments", "descriptors", "stimuli", "responses"} <= set(told)
    assert all(spent >= 0 for spent in answer.timings_ms.values())


def test_a_caller_can_give_up_between_stages(application: Application, clouds: list[PointCloud]) -> None:
    def give_up(stage: str) -> None:
        if stage == "segments":
            raise Cancelled("enough")

    with pytest.raises(Cancelled):
        application.respond(clouds[0], on_stage=give_up)


def test_top_shortens_the_list_and_nothing_else(application: Application, clouds: list[PointCloud]) -> None:
    whole, best = application.respond(clouds[0]), application.respond(clouds[0], top=1)
    assert best.concepts == whole.concepts[:1]
    assert best.responses == whole.responses
    with pytest.raises(InvalidParameter):
        application.respond(clouds[0], top=0)


def test_an_explanation_says_what_the_engine_said(
    application: Application, model: ShapeModel, clouds: list[PointCloud]
) -> None:
    response = model.respond(clouds[2], explain=True, segments=True)
    answer = application.respond(clouds[2], explain=True, segments=True)
    assert response.explanation is not None
    assert response.point_segments is not None
    assert answer.explanation is not None
    assert answer.point_segments == response.point_segments.tolist()
    for part in ("segments", "vertices", "concepts", "wholes"):
        told, said = getattr(answer.explanation, part), getattr(response.explanation, part)
        assert len(told) == len(said) > 0
        for a, b in zip(told, said, strict=True):
            assert json.dumps(a.model_dump(exclude={"nearest"})) == json.dumps(_plain(b))
    assert Answer.model_validate_json(answer.model_dump_json()) == answer


def _plain(record: Any) -> dict[str, Any]:
    return {name: value for name, value in record._asdict().items() if name != "nearest"}


def test_what_was_not_asked_for_is_not_in_the_answer(application: Application, clouds: list[PointCloud]) -> None:
    answer = application.respond(clouds[0])
    assert answer.explanation is None
    assert answer.point_segments is None
    assert not {"explanation", "point_segments", "stimuli"} & set(answer.model_dump())


def test_the_filtration_time_is_that_of_the_model_unless_given(
    application: Application, model: ShapeModel, clouds: list[PointCloud]
) -> None:
    assert application.respond(clouds[0]).time == model.filtration.epsilon_max
    assert application.respond(clouds[0], time=1.0).time == 1.0
    for wrong in (-0.1, 1.1, float("nan")):
        with pytest.raises(InvalidParameter):
            application.respond(clouds[0], time=wrong)


def test_model_version_and_alias_can_be_said_in_one_or_apart(application: Application, model: ShapeModel) -> None:
    application.store.publish(model, name="tiny", seed=7, source={}, alias="staging")
    for asked in (
        {"model": "tiny:2"},
        {"model": "tiny@staging"},
        {"model": "tiny", "version": 2},
        {"alias": "staging"},
    ):
        assert application.which(**{"model": None, **asked}) == ("tiny", 2)
    assert application.which(None) == application.which("tiny") == ("tiny", 1)
    for contradiction in ({"model": "tiny:2", "version": 1}, {"model": "tiny", "version": 1, "alias": "staging"}):
        with pytest.raises(InvalidParameter):
            application.which(**contradiction)


def test_without_a_default_several_models_must_be_told_apart(application: Application, model: ShapeModel) -> None:
    application.store.publish(model, name="other", seed=7, source={})
    with pytest.raises(InvalidParameter, match="other, tiny"):
        application.which(None)
    assert application.ready().model is None
    chosen = Application(application.settings.model_copy(update={"model": "other"}))
    assert chosen.which(None) == ("other", 1)
    assert chosen.which(None, version=1) == ("other", 1)
    assert (chosen.ready().model, chosen.ready().version) == ("other", 1)
    chosen.close()


def test_a_store_without_models_is_not_ready(settings: Settings, tmp_path: Path) -> None:
    application = Application(settings.model_copy(update={"store": str(tmp_path / "nothing"), "built_in": False}))
    with pytest.raises(ModelNotFound, match="no model yet"):
        application.ready()
    with pytest.raises(ModelNotFound, match="train"):
        application.which(None)
    assert application.models.all() == []
    application.close()


def test_a_damaged_default_model_is_not_ready(application: Application) -> None:
    for blob in (Path(application.settings.store) / "blobs" / "sha256").iterdir():
        blob.write_bytes(blob.read_bytes()[:-1])
    with pytest.raises(ModelDamaged):
        application.ready()


def test_a_loaded_version_needs_its_store_no_more(application: Application, clouds: list[PointCloud]) -> None:
    before = application.respond(clouds[0])
    for blob in (Path(application.settings.store) / "blobs" / "sha256").iterdir():
        blob.unlink()
    assert without_timings(application.respond(clouds[0])) == without_timings(before)


def test_a_service_goes_on_answering_while_its_store_is_away(
    application: Application, clouds: list[PointCloud], caplog: pytest.LogCaptureFixture
) -> None:
    before = application.respond(clouds[0])
    folder = Path(application.settings.store)
    folder.rename(folder.with_name("away"))
    folder.write_bytes(b"")
    time.sleep(1.1)
    assert without_timings(application.respond(clouds[0])) == without_timings(before)
    assert application.ready().model == "tiny"
    assert "going on with what was known" in caplog.text


def test_a_promotion_by_another_process_takes_effect_within_a_moment(
    application: Application, model: ShapeModel
) -> None:
    elsewhere = ModelStore(application.settings.store)
    elsewhere.publish(model, name="tiny", seed=7, source={}, alias=None)
    assert application.which("tiny") == ("tiny", 1)
    elsewhere.promote("tiny", 2)
    time.sleep(1.1)
    assert application.which("tiny") == ("tiny", 2)


def test_only_so_many_models_stay_in_memory(settings: Settings, model: ShapeModel, clouds: list[PointCloud]) -> None:
    store = ModelStore(settings.store)
    for _ in range(3):
        store.publish(model, name="tiny", seed=7, source={})
    application = Application(settings.model_copy(update={"loaded_models": 2}))
    for version in (1, 2, 1, 3):
        application.respond(clouds[0], model="tiny", version=version)
    for blob in (Path(settings.store) / "blobs" / "sha256").iterdir():
        blob.unlink()
    for version in (1, 3):
        application.respond(clouds[0], model="tiny", version=version)
    with pytest.raises(ModelDamaged):
        application.respond(clouds[0], model="tiny", version=2)
    application.close()


def test_threads_do_not_disturb_each_other(application: Application, clouds: list[PointCloud]) -> None:
    alone = [without_timings(application.respond(cloud)) for cloud in clouds]
    with ThreadPoolExecutor(4) as threads:
        together = list(threads.map(application.respond, clouds * 3))
    assert [without_timings(answer) for answer in together] == alone * 3


def test_clouds_are_held_to_the_limits(settings: Settings) -> None:
    application = Application(settings.model_copy(update={"max_points": 150}))
    with pytest.raises(TooManyPoints):
        application.respond(PointCloud(np.ones((151, 3), np.float32)))
    with pytest.raises(TooManyPoints):
        application.respond(CloudFile(b"1 2 3\n" * 151))
    with pytest.raises(TooFewPoints):
        application.respond(CloudFile(b"1 2 3\n2 3 4\n" * 10))
    application.close()


def test_a_viewpoint_is_three_or_seven_numbers() -> None:
    assert parse_viewpoint("1,2,3").position == (1, 2, 3)
    assert parse_viewpoint("1, 2, 3, 0, 1, 0, 0").orientation == (0, 1, 0, 0)
    for wrong in ("", "1,2", "1,2,3,4", "a,b,c", "1,2,nan", "1,2,3,0,0,0,0"):
        with pytest.raises(InvalidParameter):
            parse_viewpoint(wrong)
