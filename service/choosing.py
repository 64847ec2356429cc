"""Which model a request means: one of the store, or, until the store holds one, that which came with the service."""

from __future__ import annotations

import re
import time as clock
from collections.abc import Mapping
from typing import NamedTuple

from service.built_in import built_in
from service.engine.errors import InvalidParameter, ModelNotFound, ShapeConceptsError
from service.engine.model import ShapeModel
from service.lately import Answers, Models
from service.naming import Naming
from service.settings import Settings
from service.store import NO_MODEL, PRODUCTION, REFERENCE, ModelStore

LOOKING = 1.0  # seconds that are spent on looking up what aliases mean, for the metrics


class Source(NamedTuple):
    """Models that are read: a store, what of it is in memory, and the names of its concepts."""

    store: ModelStore
    models: Models
    naming: Naming

    @classmethod
    def of(cls, store: ModelStore, limit: int, answers: Answers, *, fixed: bool = False) -> Source:
        """Of a store, with at most so many models in memory; `fixed`: their concepts cannot be named."""
        models = Models(lambda name, version: store.load(name, version)[0], limit)
        return cls(store, models, Naming(store, models, answers, fixed=fixed))


class Meant(NamedTuple):
    """The version of a model that a request means."""

    source: Source
    name: str
    version: int

    def model(self) -> ShapeModel:
        """The model itself; loaded if need be.

        Raises:
            ModelNotFound, ModelDamaged, ModelIncompatible, StoreUnavailable: it cannot be had.
        """
        return self.source.models.get(self.name, self.version)

    def names(self) -> Mapping[int, str]:
        """The names that people gave to its concepts, by the concepts' ids."""
        return self.source.naming.names(self.name, self.version).of


class Choosing:
    """Finds the models that requests mean.

    Args:
        store: of the models.
        settings: the model of requests that name none, how many stay in memory, whether the built-in one is lent.
        answers: of the store, believed for a moment.
    """

    def __init__(self, store: ModelStore, settings: Settings, answers: Answers) -> None:
        self._default = settings.model
        self._answers = answers
        self._own = Source.of(store, settings.loaded_models, answers)
        self._built_in = Source.of(built_in(), 1, answers, fixed=True) if settings.built_in else None
        self._has_models = not settings.built_in  # whether the store is known to hold any
        self._aliases: dict[tuple[str, str], int] = {}

    def meant(self, model: str | None, version: int | None = None, alias: str | None = None) -> Meant:
        """The version that is meant.

        Args:
            model: NAME, NAME@ALIAS or NAME:VERSION; None for the default model.
            version: of the model, instead of in its name.
            alias: of the version, instead of in the model's name.

        Raises:
            InvalidParameter: the three contradict each other, or several models could be meant.
            ModelNotFound: there is no such model.
        """
        source = self.source()
        reference = model or self._default or self._only_model(source)
        if version is not None and alias is not None:
            raise InvalidParameter(f"Give a version or an alias, not both: they were {version} and '{alias}'.")
        if version is None and alias is None:
            return self._resolve(source, reference)
        name, *qualifier = re.split("[@:]", reference, maxsplit=1)
        if qualifier and model:
            raise InvalidParameter(f"The model '{model}' says its version or alias already; do not give another.")
        return self._resolve(source, f"{name}:{version}" if alias is None else f"{name}@{alias}")

    def source(self) -> Source:
        """What is read: the store, or the built-in model until the store holds one."""
        if self._built_in is None or self._has_models:
            return self._own
        # Believed like any other answer of the store, so that a request has models from one source alone.
        if self._answers.get("whether there is a model", lambda: bool(self._own.store.names())):
            self._has_models = True
            return self._own
        return self._built_in

    def _only_model(self, source: Source) -> str:
        names = self.names(source)
        if len(names) == 1:
            return names[0]
        raise InvalidParameter(f"Say which model is meant: there are {', '.join(names)}.")

    def _resolve(self, source: Source, reference: str) -> Meant:
        store = source.store
        found = self._answers.get(f"the model {reference} in {store.url}", lambda: store.resolve(reference))
        if (match := REFERENCE.fullmatch(reference)) and not match["version"]:
            self._aliases[(found[0], match["alias"] or PRODUCTION)] = found[1]
        return Meant(source, *found)

    def is_lent(self, source: Source) -> bool:
        """Whether it is the built-in one."""
        return source is self._built_in

    def names(self, source: Source) -> list[str]:
        """Names of all models; there is at least one.

        Raises:
            ModelNotFound: there is none.
        """

        def read() -> list[str]:
            if names := source.store.names():
                return names
            raise ModelNotFound(NO_MODEL)

        return self._answers.get(f"the models that there are in {source.store.url}", read)

    def serving(self) -> dict[tuple[str, str], int]:
        """The version that each alias means, of those that were asked for; found out in about a second."""
        source = self._current()
        until = clock.monotonic() + LOOKING
        for name, alias in list(self._aliases):
            if clock.monotonic() < until:  # a store that is away holds up nobody who wants to know how we are
                try:
                    self._resolve(source, f"{name}@{alias}")
                except ModelNotFound:
                    self._aliases.pop((name, alias), None)
                except ShapeConceptsError:
                    continue  # the version that was served last stays
        return dict(self._aliases)

    def loaded(self) -> list[tuple[str, int]]:
        """Names and versions of the models in memory."""
        return self._current().models.loaded()

    def _current(self) -> Source:
        """As `source`, without asking the store."""
        return self._own if self._has_models else self._built_in or self._own
