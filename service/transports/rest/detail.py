"""The parameter `detail` of HTTP requests, and JSON answers."""

from __future__ import annotations

from typing import Annotated

from fastapi import Query, Response
from pydantic import BaseModel, WithJsonSchema

from service.transports.detail import PARTS

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


def as_json(document: BaseModel, exclude: object = None) -> Response:
    """An answer as it is sent. Of many points it takes a while: to be called away from the event loop."""
    return Response(document.model_dump_json(exclude=exclude), media_type="application/json")  # type: ignore[arg-type]
