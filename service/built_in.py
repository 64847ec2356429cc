"""The model that the service brings along: learned from simulated objects alone, for stores that hold none yet.

The folder `default_model` is a store like any other, written by `./run default-model` and never by the service.
"""

from __future__ import annotations

from service.store import SHIPPED, ModelStore


def built_in() -> ModelStore:
    """The store of the built-in model; to be read only."""
    return ModelStore(SHIPPED)
