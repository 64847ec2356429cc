"""Answers that a client may keep: with a tag that changes when the answer does (RFC 9110, conditional requests)."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Annotated, Any

from fastapi import Header, Response
from pydantic import BaseModel

from service import __version__

DAY = 86_400  # seconds; a version never changes, but a later software may say more of it
LASTING = f"max-age={DAY}, immutable"
CHECKED = "no-cache"  # kept, but asked about before each use

IfNoneMatch = Annotated[
    str | None,
    Header(description="`ETag` of an answer that was kept: 304 without a body says that it is so still"),
]

DOCUMENTED: dict[int | str, dict[str, Any]] = {
    304: {"description": "Not Modified: the answer that bears the tag of `If-None-Match` is so still"}
}


def tag_of(*parts: object) -> str:
    """A strong tag: equal for equal parts, answered by the same software."""
    return f'"{hashlib.sha256(repr((__version__, *parts)).encode()).hexdigest()[:32]}"'


def tagged(
    tag: str,
    if_none_match: str | None,
    cache_control: str,
    make: Callable[[], bytes | BaseModel],
    media_type: str = "application/json",
) -> Response:
    """An answer with its tag, or only that it is so still.

    Args:
        tag: of the answer.
        if_none_match: what the client has.
        cache_control: LASTING or CHECKED.
        make: the answer.
        media_type: of the answer.
    """
    headers = {"ETag": tag, "Cache-Control": cache_control}
    if is_held(tag, if_none_match):
        return Response(status_code=304, headers=headers)
    made = make()
    body = made if isinstance(made, bytes) else made.model_dump_json().encode()
    return Response(body, headers=headers, media_type=media_type)


def is_held(tag: str, if_none_match: str | None) -> bool:
    """Whether the client has the answer that bears a tag."""
    held = {entry.strip().removeprefix("W/") for entry in (if_none_match or "").split(",")}
    return tag in held or "*" in held


def tagged_by_content(document: BaseModel, if_none_match: str | None) -> Response:
    """An answer whose tag is that of what it says."""
    body = document.model_dump_json().encode()
    return tagged(tag_of(body), if_none_match, CHECKED, lambda: body)
