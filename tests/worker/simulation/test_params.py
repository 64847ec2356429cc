from __future__ import annotations

from typing import Any

import pytest
from pydantic import BaseModel, ValidationError

from service.engine.errors import InvalidParameter
from worker.simulation.params import MAX_ORDER, CameraParams, PrototypeParams, SensorParams, SimulationParams

MODELS: list[type[BaseModel]] = [SimulationParams, PrototypeParams, CameraParams, SensorParams]


def test_the_defaults_are_the_papers_orders_and_a_kinect() -> None:
    params = SimulationParams()
    assert params.orders == (1, 2, 3, 4, 5)
    assert (params.camera.width, params.camera.height, params.camera.focal) == (640, 480, 525)
    assert params.sensor.disparity_steps == 8


def test_the_paper_draws_what_alg_1_says_and_no_more() -> None:
    paper = SimulationParams.preset("paper")
    assert paper.prototypes.exposed == 0
    assert paper.orders == (1, 2, 3, 4, 5)


def test_a_preset_that_does_not_exist_is_refused_with_those_that_do() -> None:
    assert SimulationParams.preset("default") == SimulationParams()
    with pytest.raises(InvalidParameter, match="'default' and 'paper'"):
        SimulationParams.preset("papre")


@pytest.mark.parametrize(
    ("choices", "named"),
    [
        ({"orders": ()}, "orders"),
        ({"orders": (0,)}, "orders"),
        ({"orders": (1, MAX_ORDER + 1)}, "orders"),
        ({"orders": (2, 2)}, "orders"),
        ({"noise": "gaussian"}, "noise"),
        ({"renderer": "gazebo"}, "renderer"),
        ({"min_points": 0}, "min_points"),
    ],
)
def test_a_choice_out_of_its_range_is_refused_by_name(choices: dict[str, Any], named: str) -> None:
    with pytest.raises(InvalidParameter, match=named):
        SimulationParams().but(**choices)


def test_a_choice_replaces_and_none_leaves() -> None:
    params = SimulationParams(min_points=7).but(orders=(3, 1), noise=None, renderer="raycast")
    assert params == SimulationParams(min_points=7, orders=(3, 1), renderer="raycast")


@pytest.mark.parametrize(
    ("model", "values", "told"),
    [
        (PrototypeParams, {"shortest": 0.1, "longest": 0.05}, "longest"),
        (PrototypeParams, {"shortest": 0.03, "overlap": 0.008}, "overlap"),
        (CameraParams, {"nearest": 1.0, "farthest": 0.9}, "farthest"),
        (CameraParams, {"lowest": 90}, "lowest"),
        (SensorParams, {"grazing": 90}, "grazing"),
        (SimulationParams, {"colour": "red"}, "colour"),
    ],
)
def test_values_that_contradict_each_other_are_refused(
    model: type[BaseModel], values: dict[str, Any], told: str
) -> None:
    with pytest.raises(ValidationError, match=told):
        model(**values)


@pytest.mark.parametrize("model", MODELS)
def test_every_parameter_says_what_it_means(model: type[BaseModel]) -> None:
    for name, field in model.model_fields.items():
        is_group = isinstance(field.default, BaseModel)
        assert is_group or field.description, name


@pytest.mark.parametrize("model", MODELS)
def test_parameters_cannot_be_changed(model: type[BaseModel]) -> None:
    name = next(iter(model.model_fields))
    with pytest.raises(ValidationError, match="frozen"):
        setattr(model(), name, getattr(model(), name))
