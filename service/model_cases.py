"""The use cases on models: which there are, what is in them, and which of them answers."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, Field

from service.aliases import AliasEntry
from service.catalogue import (
    AnnexationGraph,
    Barcode,
    ConceptList,
    Tree,
    list_concepts,
    tell_annexations,
    tell_barcode,
    tell_tree,
)
from service.choosing import Choosing, Meant
from service.comparing import Version, VersionComparison, compare_versions
from service.lately import Answers
from service.model_file import Manifest
from service.store import PRODUCTION, ModelStore


class ModelSummary(BaseModel):
    """A model that can be asked."""

    name: str = Field(description="the model's name")
    versions: list[int] = Field(description="its versions, ascending")
    aliases: dict[str, int] = Field(description="what each alias means now")
    built_in: bool = Field(False, description="whether it came with the service, as the store holds no model yet")


class ModelCases:
    """The models of a store, or the built-in one if it holds none.

    Args:
        store: where models are promoted.
        choosing: which models there are.
        answers: what the store said lately.
    """

    def __init__(self, store: ModelStore, choosing: Choosing, answers: Answers) -> None:
        self._store, self._choosing, self._answers = store, choosing, answers

    def all(self) -> list[ModelSummary]:
        """All models with their versions and aliases: those of the store, or the built-in one if it holds none."""
        return [self.one(name) for name in self._choosing.source().store.names()]

    def one(self, name: str) -> ModelSummary:
        """A model with its versions and aliases.

        Raises:
            ModelNotFound: there is no such model.
        """
        source = self._choosing.source()
        versions, aliases = source.store.require(name), source.store.aliases(name)
        return ModelSummary(name=name, versions=versions, aliases=aliases, built_in=self._choosing.is_lent(source))

    def manifest(self, name: str, version: int) -> Manifest:
        """How a version was made."""
        store = self._choosing.source().store
        return self._answers.get(
            f"the manifest of {name}:{version} in {store.url}", lambda: store.manifest(name, version)
        )

    def concepts(self, name: str, version: int, time: float | None = None) -> ConceptList:
        """The concepts of a version: those at a filtration time; None for those that answers compare clouds with.

        Raises:
            InvalidParameter: the time is not in [0, 1].
        """
        meant = Meant(self._choosing.source(), name, version)
        return list_concepts(meant.model(), (name, version), time, meant.names())

    def barcode(self, name: str, version: int) -> Barcode:
        """The bars of H_0 of a version's filtration."""
        return tell_barcode(Meant(self._choosing.source(), name, version).model(), (name, version))

    def annexations(self, name: str, version: int) -> AnnexationGraph:
        """The annexation graph F of a version."""
        return tell_annexations(Meant(self._choosing.source(), name, version).model(), (name, version))

    def tree(self, name: str, version: int) -> Tree:
        """The spanning tree of a version's topological space."""
        return tell_tree(Meant(self._choosing.source(), name, version).model(), (name, version))

    def compare(self, old: tuple[str, int], new: tuple[str, int]) -> VersionComparison:
        """Which concepts of one version persist, merge, split or disappear in another one. Runs on the caller's thread.

        Args:
            old: name and version of the model that concepts come from.
            new: name and version of the one that they go to.

        Raises:
            InvalidParameter: there is nothing to compare them by.
        """
        source = self._choosing.source()
        meant = (Meant(source, *which) for which in (old, new))
        return compare_versions(*(Version(m.name, m.version, m.model(), m.names()) for m in meant))

    def histories(self, name: str) -> dict[str, list[AliasEntry]]:
        """All that each alias of a model has meant, oldest first.

        Raises:
            ModelNotFound: there is no such model.
        """
        store = self._choosing.source().store
        store.require(name)
        return {alias: store.alias_history(name, alias) for alias in store.aliases(name)}

    def export(self, name: str, version: int, out_dir: Path) -> list[Path]:
        """Writes a version's files into a folder; returns them."""
        return self._choosing.source().store.export(name, version, out_dir)

    def promote(self, model: str, alias: str = PRODUCTION) -> tuple[str, int]:
        """Lets an alias mean the version that a reference names; returns its name and version."""
        name, version = self._store.resolve(model)
        self._store.promote(name, version, alias)
        self._answers.forget()
        return name, version

    def rollback(self, name: str, alias: str = PRODUCTION, leaving: int | None = None) -> int:
        """Lets an alias mean what it meant before; returns the version. `leaving`: only if it means that one now."""
        version = self._store.rollback(name, alias, leaving)
        self._answers.forget()
        return version
