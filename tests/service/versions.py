"""Two versions of a model that were truly learnt: the later one from the clouds of the earlier one and more."""

from __future__ import annotations

from functools import cache

from service.engine.model import ShapeModel
from service.engine.params import ModelParams
from tests.learnt import objects
from worker.learning.train import NamedCloud, train


@cache
def learnt_from(first: int, end: int, seed: int = 0, step: int = 1) -> ShapeModel:
    """A model of some of 24 objects; with step -1 in reverse order."""
    clouds = [NamedCloud(f"{simulated.index}.ply", simulated.cloud) for simulated in objects(24)[first:end]]
    return train(clouds[::step], ModelParams(), seed).model


def small() -> ShapeModel:
    """Of 18 clouds."""
    return learnt_from(0, 18)


def grown() -> ShapeModel:
    """Of these, and 6 more."""
    return learnt_from(0, 24)
