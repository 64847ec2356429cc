"""Small models that were truly learnt, and what they were learnt from; each is made when first asked for."""

from __future__ import annotations

from functools import cache

from service.engine.model import ShapeModel
from service.engine.params import ModelParams
from service.engine.perception import Perception, perceive
from tests.shapes import CAMERA
from worker.learning.train import NamedCloud, train
from worker.simulation import SimulatedObject, SimulationParams, simulate

SIMULATION = SimulationParams(renderer="raycast", camera=CAMERA.model_copy(update={"nearest": 0.9}), orders=(1, 2, 3))
PRESETS = ("default", "paper")


@cache
def objects(count: int = 14, seed: int = 5, noise: str = "kinect") -> tuple[SimulatedObject, ...]:
    """Simulated objects of up to three prototypes."""
    return tuple(simulate(count, seed, params=SIMULATION.but(noise=noise), workers=1))


def named_clouds(count: int = 14) -> list[NamedCloud]:
    """The training clouds."""
    return [NamedCloud(f"{simulated.index}.ply", simulated.cloud) for simulated in objects()[:count]]


@cache
def learnt(preset: str = "default") -> ShapeModel:
    """The model of a preset, learnt from the training clouds."""
    return train(named_clouds(), ModelParams.preset(preset)).model


@cache
def perceived(preset: str = "default") -> tuple[Perception, ...]:
    """The training clouds as a preset's parameters see them."""
    return tuple(perceive(named.cloud, ModelParams.preset(preset)) for named in named_clouds())
