"""How much of an answer is sent: the parameter `detail`."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from fastapi import Query, Response
from pydantic import BaseModel, WithJsonSchema

from service.engine.errors import InvalidParameter

PARTS = {
    "concepts": "the ranked concepts, which are always there, and nothing of all that follows",
    "responses": "responses and distances to every concept, in concept order",
    "stimuli": "the stimuli vector",
    "segments": "the segment of each point sent",
    "explanation": "why the answer is what it is",
}
_ONE = f"({'|'.join(PARTS)})"

DetailQuery = Annotated[
    list[Annotated[str, WithJsonSchema({"type": "string", "pattern": f"^{_ONE}(,{_ONE})*$"})]] | None,
    Query(
        max_length=len(PARTS),
        description="parts of the answer, separated by commas or given one by one: "
        + "; ".join(f"`{part}`, {what}" for part, what in PARTS.items())
        + ". By default `responses`",
        examples=[["concepts"]],
    ),
]


class Detail(NamedTuple):
    """The parts that an answer has beside its ranked concepts."""

    responses: bool
    stimuli: bool
    segments: bool
    explanation: bool

    def exclude(self) -> set[str]:
        """The fields of an answer that are left out."""
        return set() if self.responses else {"responses", "distances"}


def parse_detail(
    given: list[str] | None, *, stimuli: bool = False, segments: bool = False, explain: bool = False
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


def as_json(document: BaseModel, exclude: object = None) -> Response:
    """An answer as it is sent. Of many points it takes a while: to be called away from the event loop."""
    return Response(document.model_dump_json(exclude=exclude), media_type="application/json")  # type: ignore[arg-type]
