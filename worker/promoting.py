"""Judges a version beside the one that an alias means, and lets the alias mean it if it is not worse."""

from __future__ import annotations

from functools import cache, partial
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

from service.engine.errors import InvalidParameter
from service.engine.model import OnStage, ignore_stage
from service.store import ModelStore
from worker.evaluation.answering import AnsweredSet, Count, answer
from worker.evaluation.judging import figures_of, figures_of_both
from worker.evaluation.labels import read_labels
from worker.evaluation.promotion import Rule, Verdict, decide

TRIES = 3  # times that versions are judged, while the alias is moved by others


class Outcome(BaseModel):
    """What came of it."""

    model_config = ConfigDict(frozen=True)

    model: str = Field(description="name of the model")
    version: int = Field(description="the version that was to be promoted")
    alias: str = Field(description="the alias")
    before: int | None = Field(description="the version that the alias meant; null for none")
    promoted: bool = Field(description="whether the alias means the version now")
    reasons: list[str] = Field(description="a sentence for each figure, or what else decided")
    figures: dict[str, float] | None = Field(description="of the version, in [0, 1], 1 is best; null if not judged")
    figures_before: dict[str, float] | None = Field(description="of the version that the alias meant")

    def sentence(self) -> str:
        """What the alias means now."""
        if self.promoted:
            return f"{self.model}@{self.alias} is version {self.version} now."
        return f"{self.model}@{self.alias} is version {self.before} still; {self.version} is not promoted."


def promote_by_rule(
    store: ModelStore,
    model: str,
    alias: str,
    labels: Path,
    rule: Rule,
    on_stage: OnStage = ignore_stage,
    count: Count = lambda items, total: items,
    *,
    only_forward: bool = False,
) -> Outcome:
    """Promotes a version unless it is worse than the one that the alias means.

    Args:
        store: of the models.
        model: NAME:VERSION or NAME@ALIAS.
        alias: to move.
        labels: `labels.csv` of the clouds that judge.
        rule: what counts as worse.
        on_stage: called as each stage begins.
        count: hands on what it is given, and may show how far that is.
        only_forward: whether an alias that means a later version stays.

    Raises:
        ModelNotFound, ModelDamaged, ModelIncompatible: a version cannot be had.
        InvalidParameter: the labels cannot be used, or are too few to judge by; or others move the alias all the time.
    """
    name, version = store.resolve(model)
    labelled = read_labels(labels)

    @cache
    def answered(number: int) -> AnsweredSet:
        on_stage(f"responses of {name}:{number}")
        return answer(store.load(name, number)[0], labels, labelled, False, count)

    for _ in range(TRIES):
        before = store.aliases(name).get(alias)
        outcome = partial(_outcome, name, version, alias, before)
        if before == version:
            return outcome(Verdict(True, (f"{name}@{alias} is version {version} already",)))
        if only_forward and before is not None and before > version:
            return outcome(Verdict(False, (f"{name}@{alias} means version {before} by now, which is later",)))
        if before is None:
            own, figures = None, figures_of(answered(version))
        else:
            old, new = answered(before), answered(version)
            on_stage("figures")
            own, figures = figures_of_both(old, new)
        verdict = decide(own, figures, rule)
        if not verdict.promote or store.exchange(name, before, version, alias):
            return outcome(verdict, figures, own)
    raise InvalidParameter(f"{name}@{alias} is moved all the time while {name}:{version} is judged: try again later.")


def _outcome(
    name: str,
    version: int,
    alias: str,
    before: int | None,
    verdict: Verdict,
    figures: dict[str, float] | None = None,
    own: dict[str, float] | None = None,
) -> Outcome:
    return Outcome(
        model=name,
        version=version,
        alias=alias,
        before=before,
        promoted=verdict.promote,
        reasons=list(verdict.reasons),
        figures=figures,
        figures_before=own,
    )
