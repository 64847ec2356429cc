"""The cloud in the body of a request: as the body itself, or as a part of a form. Never more than the limit is read."""

from __future__ import annotations

import asyncio

from fastapi import Request
from starlette.datastructures import UploadFile
from starlette.exceptions import HTTPException
from starlette.types import Message

from service.clouds import by_media_type
from service.engine.errors import UnreadableCloud

FIELD = "cloud"


async def receive_cloud(request: Request, max_bytes: int, timeout: float) -> tuple[bytes, str | None, str]:
    """Receives the file of a request.

    Args:
        request: with the file as its body, or with a form that has it in the field `cloud`.
        max_bytes: limit on the whole body; it is enforced while the body arrives.
        timeout: limit on the time that takes, seconds.

    Returns:
        The file's bytes, its format (None where the content has to tell), and its name ("" for none).

    Raises:
        UnsupportedFormat: the media type is not that of a cloud.
        UnreadableCloud: the form is malformed or has no such field.
        HTTPException: 413, the body is larger than the limit; 408, it did not arrive in time.
    """
    media_type = request.headers.get("content-type", "")
    form = media_type.partition(";")[0].strip().lower() == "multipart/form-data"
    format = None if form else by_media_type(media_type)
    _check_announced(request, max_bytes)
    limited = Request(request.scope, _Limited(request, max_bytes))
    try:
        async with asyncio.timeout(timeout):
            if form:
                return await _from_form(limited)
            return await limited.body(), format, ""
    except TimeoutError:
        raise HTTPException(408, f"The body did not arrive within {timeout:g} seconds.") from None


async def _from_form(request: Request) -> tuple[bytes, str | None, str]:
    try:
        async with request.form(max_files=1, max_fields=8) as form:
            part = form.get(FIELD)
            if not isinstance(part, UploadFile):
                raise UnreadableCloud(f"The form has no file in the field '{FIELD}': send it with -F {FIELD}=@FILE.")
            return await part.read(), by_media_type(part.content_type or ""), part.filename or ""
    except HTTPException as error:
        if error.status_code != 400:
            raise
        raise UnreadableCloud(f"The form cannot be read: {error.detail}") from error


def _check_announced(request: Request, max_bytes: int) -> None:
    announced = request.headers.get("content-length", "")
    if announced.isdecimal() and int(announced) > max_bytes:
        raise _too_large(max_bytes)


def _too_large(max_bytes: int) -> HTTPException:
    return HTTPException(
        413, f"The body is larger than the {max_bytes} bytes that are taken. Send fewer points, or a binary format."
    )


class _Limited:
    """Receives the body of a request until it grows too large."""

    def __init__(self, request: Request, max_bytes: int) -> None:
        self._receive = request.receive
        self._left = self._max_bytes = max_bytes

    async def __call__(self) -> Message:
        message = await self._receive()
        self._left -= len(message.get("body", b""))
        if self._left < 0:
            raise _too_large(self._max_bytes)
        return message
