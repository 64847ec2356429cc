"""Promotion by rule: an alias moves to a new version only if that is not worse than the one which it means.

Both versions answer the same labelled clouds, and the figures of the quality protocol are compared, one by one: a
version that is better in three and worse in the fourth is worse, since nobody asked to trade them. Figures differ by
chance: models of other seeds have figures that scatter by 0.01 to 0.02 (`tests/benchmarks/QUALITY.md`), so that much
is tolerated unless the rule says otherwise.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from pydantic import BaseModel, ConfigDict, Field

TOLERANCE = 0.02
ROUNDING = 1e-9  # of differences between figures


class Rule(BaseModel):
    """What counts as worse."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    tolerance: float = Field(
        TOLERANCE, ge=0, le=1, description="by how much each figure may be lower than before, in [0, 1]"
    )


class Verdict(NamedTuple):
    """Whether a version is promoted, and why.

    Attributes:
        promote: whether it is.
        reasons: a sentence for each figure, or what else decided.
    """

    promote: bool
    reasons: tuple[str, ...]


def decide(old: Mapping[str, float] | None, new: Mapping[str, float], rule: Rule) -> Verdict:
    """Whether a new version is not worse than the old one.

    Args:
        old: figures of the version that the alias means, by name, in [0, 1], 1 is best; None where it means none.
        new: figures of the new version, by the same clouds.
        rule: what counts as worse.
    """
    if old is None:
        return Verdict(True, ("there is no version yet that it could be worse than",))
    told = [_compare(name, value, new.get(name), rule.tolerance) for name, value in old.items()]
    return Verdict(all(good for good, _ in told), tuple(reason for _, reason in told))


def _compare(name: str, old: float, new: float | None, tolerance: float) -> tuple[bool, str]:
    """Whether one figure is good enough, and why."""
    if new is None:
        return False, f"{name} is not known of the new version, and was {old:.3f}"
    said = f"{name} {new:.3f}, before {old:.3f}"
    if new >= old:
        return True, f"{said}: not worse"
    if new >= old - tolerance - ROUNDING:
        return True, f"{said}: worse by {old - new:.3f}, which is tolerated (up to {tolerance:g})"
    return False, f"{said}: worse by {old - new:.3f}, more than the tolerated {tolerance:g}"
