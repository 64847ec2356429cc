"""The arms of the quality study: the default with some parameters set otherwise."""

from __future__ import annotations

from typing import NamedTuple

from pydantic import ValidationError

from service.engine.errors import InvalidParameter
from service.engine.params import ModelParams
from worker.simulation import SimulationParams

DEFAULT = "default"
WHOLE = "the whole object alone"
PAPER = "preset paper"

ARMS: dict[str, str] = {
    DEFAULT: "",
    WHOLE: "stimuli.segment_weight=0 stimuli.union_weight=0",
    "single segments alone": "stimuli.union_weight=0 stimuli.whole_weight=0",
    "unions alone": "stimuli.segment_weight=0 stimuli.union_weight=1 stimuli.whole_weight=0",
    "unions as heavy as the rest": "stimuli.union_weight=1",
    "unions of two segments, as heavy": "stimuli.union_weight=1 hierarchy.max_levels=2",
    "unions of two or three segments, as heavy": "stimuli.union_weight=1 hierarchy.max_levels=3",
    "any constellation excites any vertex": "stimuli.gating=kernel stimuli.pooling=max stimuli.balanced=false",
    "sigma 0.05": "stimuli.sigma=0.05",
    "sigma 0.2": "stimuli.sigma=0.2",
    "coverage not squared": "stimuli.coverage_power=1",
    "4 levels of words": "dictionary.levels=4",
    "8 levels of words": "dictionary.levels=8",
    "8 dimensions": "response.dimensions=8",
    "32 dimensions": "response.dimensions=32",
    "Ledoit and Wolf's covariance": "response.metric=shrunk",
    "Hellinger": "response.power=0.5",
    "epsilon_max alone": "response.scales=1",
    "5 scales": "response.scales=5",
    "30 scales": "response.scales=30",
    "epsilon_max of single steps": "filtration.window=0",
    "FPFH alone": "descriptor.shape_weight=0",
    "half FPFH": "descriptor.shape_weight=0.5",
    "8000 draws": "descriptor.draws=8000",
    PAPER: "preset=paper",
}
TUNING = (  # settings that the default was tuned by, to tune the whole object alone by the same
    "sigma 0.05",
    "sigma 0.2",
    "4 levels of words",
    "8 levels of words",
    "8 dimensions",
    "32 dimensions",
    "Hellinger",
    "5 scales",
    "30 scales",
    "epsilon_max of single steps",
)


class Arm(NamedTuple):
    """What a model is learnt with."""

    params: ModelParams
    simulation: SimulationParams


def arm_of(name: str) -> Arm:
    """An arm by its name, by parameters ("stimuli.sigma=0.1 ..."), or by several of these with " + " between.

    Raises:
        SystemExit: there is no such arm or parameter.
    """
    preset, changed = DEFAULT, dict[str, dict[str, str]]()
    for setting in " ".join(ARMS.get(part, part) for part in name.split(" + ")).split():
        path, _, value = setting.partition("=")
        if path == "preset":
            preset = value
            continue
        stage, _, parameter = path.partition(".")
        changed.setdefault(stage, {})[parameter] = value
    try:
        stages = ModelParams.preset(preset).model_dump()
        params = ModelParams.model_validate(
            stages | {stage: stages.get(stage, {}) | values for stage, values in changed.items()}
        )
        simulation = SimulationParams.preset(preset)
    except (ValidationError, InvalidParameter) as error:
        raise SystemExit(f"There is no arm '{name}': {error}") from None
    return Arm(params, simulation)
