"""The model that the service brings along: learned from simulated objects alone, for stores that hold none yet.

The folder `default_model` is a store like any other, written by `./run default-model` and never by the service.
"""

from __future__ import annotations

from pathlib import Path

from service.store import ModelStore

FOLDER = Path(__file__).with_name("default_model")


def built_in() -> ModelStore:
    """The store of the built-in model; to be read only."""
    return ModelStore(FOLDER)
