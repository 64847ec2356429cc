"""The use cases on names of concepts: give, take away, look back, carry over, and propose from labelled clouds."""

from __future__ import annotations

from collections.abc import Sequence

from service.answer import Answer
from service.carrying import CarriedName, keep_carried, names_to_carry
from service.comparing import WORK
from service.engine.compare import affordable
from service.engine.concepts import is_concept
from service.engine.errors import ConceptNotFound, InvalidParameter
from service.lately import Answers, Models
from service.names import NO_NAMES, NameEntry, Names, check_concept_name
from service.proposals import Proposal, propose
from service.store import ModelStore


class Naming:
    """The names of concepts, by name and version of the model; every replica has them within seconds.

    Args:
        store: that holds the models and the names.
        models: in memory.
        answers: of the store, that were read lately.
        fixed: whether names can only be read, as the store is the built-in model's.
    """

    def __init__(self, store: ModelStore, models: Models, answers: Answers, *, fixed: bool = False) -> None:
        self._fixed = fixed
        self._store = store
        self._models = models
        self._answers = answers
        self._read: dict[tuple[str, int], Names] = {}

    def names(self, name: str, version: int) -> Names:
        """The names of a version's concepts."""

        def read() -> Names:
            known = self._read.get((name, version), NO_NAMES)
            names = self._read[name, version] = self._store.concept_names(name, version).read(known)
            return names

        return self._answers.get(f"the names of {name}:{version} in {self._store.url}", read)

    def history(self, name: str, version: int, concept: int) -> list[NameEntry]:
        """All that a concept was called, oldest first.

        Raises:
            ConceptNotFound: the version has no such concept.
        """
        self._require(name, version, concept)
        return self._store.concept_names(name, version).history(concept)

    def rename(self, name: str, version: int, concept: int, given: str | None) -> str | None:
        """Names a concept, or takes its name away; returns the name as it is kept.

        Raises:
            ConceptNotFound: the version has no such concept.
            InvalidParameter: it cannot be a name.
        """
        kept = None if given is None else check_concept_name(given)
        self._require(name, version, concept)
        self._change(name, version, {concept: kept})
        return kept

    def propose(
        self, name: str, version: int, labelled: Sequence[tuple[str, Answer]], *, apply: bool
    ) -> list[Proposal]:
        """Proposes a name for each concept that is the best one of a labelled cloud.

        Args:
            name: of the model.
            version: of the model, which gave the answers.
            labelled: labels, as `check_concept_name` returned them, and the answers to their clouds.
            apply: whether concepts for which one label was proposed are called so from now on.
        """
        best = [(answer.concepts[0].id, label) for label, answer in labelled if answer.concepts]
        proposals = propose(best, self.names(name, version).of)
        if apply and (named := {entry.concept: entry.name for entry in proposals if entry.name is not None}):
            self._change(name, version, dict(named))
        return proposals

    def carry(self, source: tuple[str, int], target: tuple[str, int]) -> list[CarriedName]:
        """Carries the names of one version over to another one, where they fit and nobody has named the concept.

        Args:
            source: name and version of the model that has names.
            target: name and version of the one that gets them.

        Raises:
            InvalidParameter: it is the same version, or there is nothing to compare them by.
        """
        if source == target:
            raise InvalidParameter(f"{'{}:{}'.format(*source)} has its own names already: say another version.")
        self._refuse_fixed(*target)
        names = self.names(*source).of
        if not names:
            return []
        old, new = self._models.get(*source), self._models.get(*target)
        fitting = names_to_carry(old, names, new, affordable(old, new, WORK))
        kept = keep_carried(self._store, source, target, fitting)
        self._answers.forget()
        return kept

    def _change(self, name: str, version: int, changed: dict[int, str | None]) -> None:
        self._refuse_fixed(name, version)
        self._store.concept_names(name, version).change(changed)
        self._answers.forget()

    def _refuse_fixed(self, name: str, version: int) -> None:
        if self._fixed:
            raise InvalidParameter(
                f"{name}:{version} came with the service, and its concepts cannot be named: train and publish a model "
                "of your own, with shape-concepts-worker train --simulate 250 --name default"
            )

    def _require(self, name: str, version: int, concept: int) -> None:
        if not is_concept(self._models.get(name, version).filtration, concept):
            raise ConceptNotFound(
                f"{name}:{version} has no concept {concept} at any filtration time. Ids are those that answers and the "
                "listing of its concepts give; another version has other ones."
            )
