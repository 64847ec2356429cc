"""The training configuration file: parameters of the stages and of the simulation, over a preset."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from service.engine.errors import InvalidParameter
from service.engine.params import ModelParams, StageParams
from worker.simulation.params import SimulationParams


class TrainingConfig(StageParams):
    """How a model is made: the parameters of every stage, and of the simulation if there is one."""

    model: ModelParams = ModelParams()
    simulation: SimulationParams = SimulationParams()


def read_config(file: Path) -> TrainingConfig:
    """Reads a TOML or JSON file.

    At the top stand `preset` ("default" or "paper"), a table for each stage whose parameters differ from the preset's
    (`[segments]`, `[stimuli]`, ...), and `[simulation]`.

    Raises:
        InvalidParameter: the file cannot be read, or says something that is not a parameter.
    """
    try:
        text = file.read_text()
        given: dict[str, Any] = json.loads(text) if file.suffix == ".json" else tomllib.loads(text)
    except (OSError, UnicodeDecodeError, ValueError) as error:
        raise InvalidParameter(
            f"The configuration {file} cannot be read as TOML or, named .json, as JSON: {error}."
        ) from error
    if not isinstance(given, dict):
        raise InvalidParameter(
            f"The configuration {file} is a {type(given).__name__}, where a table of stages should be."
        )
    preset = str(given.pop("preset", "default"))
    stages = ModelParams.preset(preset).model_dump()
    simulation = SimulationParams.preset(preset).model_dump()
    try:
        for part, chosen in {**given.pop("simulation", {})}.items():
            before = simulation.get(part)
            if isinstance(before, dict) and isinstance(chosen, dict):
                chosen = {**before, **chosen}
            simulation[part] = chosen
        for stage, chosen in given.items():
            stages[stage] = {**stages.get(stage, {}), **chosen}
        return TrainingConfig.model_validate({"model": stages, "simulation": simulation})
    except (ValidationError, TypeError) as error:
        raise InvalidParameter(f"The configuration {file} says what cannot be: {_faults(error)}.") from error


def _faults(error: ValidationError | TypeError) -> str:
    if isinstance(error, TypeError):
        return "a stage's parameters stand in a table of their own"
    faults = ((e["loc"], e["msg"].removeprefix("Value error, ")) for e in error.errors())
    said = ((".".join(map(str, place[place[0] == "model" :])), what) for place, what in faults)
    return "; ".join(
        f"{place}: {what.replace('Extra inputs are not permitted', 'there is no such parameter')}"
        for place, what in said
    )
