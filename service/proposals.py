"""Names for concepts, proposed from a few labelled clouds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping

from pydantic import BaseModel, ConfigDict, Field


class Proposal(BaseModel):
    """What one concept might be called."""

    model_config = ConfigDict(frozen=True)

    concept: int = Field(description="node of the concept in the model's merge tree")
    name: str | None = Field(description="the label of most of its clouds; null if several labels tie")
    current: str | None = Field(description="what it is called now, null for nothing")
    support: int = Field(ge=1, description="labelled clouds of which it is the best concept")
    share: float = Field(gt=0, le=1, description="of these, how many bear the most frequent label")
    labels: dict[str, int] = Field(description="how many of them bear each label, most frequent first")
    tied: list[str] = Field(description="the labels that are equally frequent, if several are; empty otherwise")


def propose(best: Iterable[tuple[int, str]], names: Mapping[int, str]) -> list[Proposal]:
    """Proposes for each concept the label that most of its clouds bear.

    Args:
        best: for each cloud its best concept and its label.
        names: the names that there are.

    Returns:
        The proposals, those with most clouds first.
    """
    found: dict[int, Counter[str]] = {}
    for concept, label in best:
        found.setdefault(concept, Counter())[label] += 1
    proposals = [_proposal(concept, labels, names.get(concept)) for concept, labels in found.items()]
    return sorted(proposals, key=lambda proposal: (-proposal.support, proposal.concept))


def _proposal(concept: int, labels: Counter[str], current: str | None) -> Proposal:
    ranked = dict(sorted(labels.items(), key=lambda label: (-label[1], label[0])))
    most = max(ranked.values())
    first = [label for label, count in ranked.items() if count == most]
    return Proposal(
        concept=concept,
        name=first[0] if len(first) == 1 else None,
        current=current,
        support=labels.total(),
        share=most / labels.total(),
        labels=ranked,
        tied=first if len(first) > 1 else [],
    )
