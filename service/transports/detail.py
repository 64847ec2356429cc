"""How much of an answer is sent, on the wires that send JSON: the parameter `detail`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

from service.engine.errors import InvalidParameter

PARTS = {
    "concepts": "the ranked concepts, which are always there, and nothing of all that follows",
    "responses": "responses and distances to every concept, in concept order",
    "stimuli": "the stimuli vector",
    "segments": "the segment of each point sent",
    "explanation": "why the answer is what it is",
}


class Detail(NamedTuple):
    """The parts that an answer has beside its ranked concepts."""

    responses: bool
    stimuli: bool
    segments: bool
    explanation: bool

    def exclude(self, *, scene: bool = False) -> Any:
        """The fields that are left out of an answer, or of a scene's, in pydantic's form."""
        left_out = set() if self.responses else {"responses", "distances"}
        return {"objects": {"__all__": {"answer": left_out}}} if scene else left_out


def parse_detail(
    given: Iterable[str] | None, *, stimuli: bool = False, segments: bool = False, explain: bool = False
) -> Detail:
    """The parts that are asked for by `detail`, and by the flags, each of which adds one.

    Raises:
        InvalidParameter: there is no such part.
    """
    parts = {part.strip() for text in given or ["responses"] for part in text.split(",")}
    if unknown := sorted(parts - set(PARTS)):
        raise InvalidParameter(f"There is no detail '{unknown[0][:60]}'; there are {', '.join(PARTS)}.")
    return Detail(
        "responses" in parts,
        stimuli or "stimuli" in parts,
        segments or "segments" in parts,
        explain or "explanation" in parts,
    )
