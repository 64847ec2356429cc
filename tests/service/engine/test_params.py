"""Parameters: bounded, frozen, described, and the paper's own at hand."""

from __future__ import annotations

import pytest
from pydantic import BaseModel, ValidationError

from service.engine.errors import InvalidParameter
from service.engine.params import PRESETS, HierarchyParams, ModelParams, StimuliParams

STAGES = {name: field.annotation for name, field in ModelParams.model_fields.items()}
FIELDS = [(s, n, f) for s, stage in STAGES.items() for n, f in stage.model_fields.items()]


def test_the_paper_is_a_preset_with_its_own_numbers():
    paper = ModelParams.preset("paper")
    assert paper.stimuli.sigma == 0.025
    assert (paper.stimuli.gating, paper.stimuli.pooling, paper.stimuli.coverage_power) == ("words", "sum", 0)
    assert paper.descriptor.shape_weight == 0
    assert paper.dictionary.levels == 4
    assert not paper.hierarchy.whole_apart
    assert not paper.stimuli.balanced
    assert paper.stimuli.cutoff == 0
    assert paper.filtration.window == 0
    assert (paper.response.score, paper.response.scales, paper.response.power) == ("distance", 1, 1)
    assert paper.patches.normal_weight == 1
    assert paper.patches.spatial_weight == 0.4


def test_a_preset_that_does_not_exist_is_refused_with_those_that_do():
    assert ModelParams.preset("default") == ModelParams()
    with pytest.raises(InvalidParameter, match="'default' and 'paper'"):
        ModelParams.preset("papre")


@pytest.mark.parametrize("preset", ["default", "paper"])
def test_parameters_survive_json(preset: str):
    params = ModelParams.preset(preset)
    assert ModelParams.model_validate_json(params.model_dump_json()) == params


def test_every_parameter_is_described_and_every_number_bounded():
    for stage, name, field in FIELDS:
        assert field.description, f"{stage}.{name}"
        if field.annotation in (int, float):
            assert field.metadata, f"{stage}.{name} has no bounds"


@pytest.mark.parametrize("stage", STAGES)
def test_misspelt_and_changed_parameters_are_refused(stage: str):
    params: BaseModel = STAGES[stage]()
    with pytest.raises(ValidationError):
        STAGES[stage](no_such_parameter=1)
    name = next(iter(STAGES[stage].model_fields))
    with pytest.raises(ValidationError, match="frozen"):
        setattr(params, name, getattr(params, name))


def test_motif_levels_that_are_balanced_by_no_weight_at_all_are_refused():
    none = {"segment_weight": 0, "union_weight": 0, "whole_weight": 0}
    with pytest.raises(ValidationError, match="whole_weight"):
        StimuliParams(balanced=True, **none)
    assert not StimuliParams(balanced=False, **none).balanced
    for name in none:
        assert StimuliParams(balanced=True, **{**none, name: 0.5}).balanced


@pytest.mark.parametrize(("stage", "name"), [(s, n) for s, n, f in FIELDS if f.annotation in (int, float)])
def test_numbers_that_are_none_are_refused(stage: str, name: str):
    for nonsense in (float("nan"), float("-inf"), -1e12, "many"):
        with pytest.raises(ValidationError):
            ModelParams.model_validate({stage: {name: nonsense}})


def test_unions_count_wherever_they_excite_anything():
    assert not ModelParams().unions_count
    assert ModelParams.preset("paper").unions_count
    assert ModelParams(stimuli=StimuliParams(union_weight=0.5)).unions_count
    assert ModelParams(stimuli=StimuliParams(gating="kernel")).unions_count
    assert ModelParams(hierarchy=HierarchyParams(whole_apart=False)).unions_count


def test_the_schema_tells_what_each_preset_has_different():
    told = ModelParams.model_json_schema()["x-presets"]
    assert {name: ModelParams.model_validate(told[name]) for name in told} == {
        name: ModelParams.preset(name) for name in PRESETS
    }
    assert told["default"] == {}
