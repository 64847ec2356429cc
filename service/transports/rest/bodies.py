"""The cloud in the body of a request: as the body itself, or as a part of a form. Never more than the limit is read."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import NamedTuple

from fastapi import Request
from starlette.datastructures import UploadFile
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.types import Message

from service.clouds import by_media_type
from service.engine.errors import Cancelled, UnreadableCloud

FIELD = "cloud"


class Limits(NamedTuple):
    """What a body may be.

    Attributes:
        max_bytes: size of the whole; enforced while it arrives.
        timeout: longest time it may take to arrive, seconds.
        pause: longest time in which nothing of it arrives, seconds.
    """

    max_bytes: int
    timeout: float
    pause: float


async def receive_cloud(request: Request, limits: Limits, take: Callable[[int], None]) -> tuple[bytes, str | None, str]:
    """Receives the file of a request.

    Args:
        request: with the file as its body, or with a form that has it in the field `cloud`.
        limits: on the body.
        take: called with the number of bytes as they arrive; may raise `Overloaded`.

    Returns:
        The file's bytes, its format (None where the content has to tell), and its name ("" for none).

    Raises:
        UnsupportedFormat: the media type is not that of a cloud.
        UnreadableCloud: the form is malformed or has no such field.
        Cancelled: the client hung up.
        HTTPException: 413, the body is larger than the limit; 408, it did not arrive in time.
    """
    media_type = request.headers.get("content-type", "")
    form = media_type.partition(";")[0].strip().lower() == "multipart/form-data"
    format = None if form else by_media_type(media_type)
    async with arriving(request, limits, take) as limited:
        if form:
            return await _from_form(limited)
        return await limited.body(), format, ""


@asynccontextmanager
async def arriving(request: Request, limits: Limits, take: Callable[[int], None]) -> AsyncIterator[Request]:
    """Yields a request whose body can be read within limits.

    Args:
        request: of which nothing was read yet.
        limits: on the body.
        take: called with the number of bytes as they arrive; may raise `Overloaded`.

    Raises:
        Cancelled: the client hung up.
        HTTPException: 413, the body is larger than the limit; 408, it did not arrive in time.
    """
    _check_announced(request, limits.max_bytes)
    try:
        async with asyncio.timeout(limits.timeout):
            yield Request(request.scope, _Limited(request, limits, take))
    except TimeoutError:
        raise HTTPException(408, f"The body did not arrive within {limits.timeout:g} seconds.") from None
    except ClientDisconnect:
        raise Cancelled("The client hung up before its request had arrived.") from None


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
    """Receives the body of a request until it grows too large or stands still."""

    def __init__(self, request: Request, limits: Limits, take: Callable[[int], None]) -> None:
        self._receive = request.receive
        self._limits = limits
        self._left = limits.max_bytes
        self._take = take

    async def __call__(self) -> Message:
        try:
            async with asyncio.timeout(self._limits.pause):
                message = await self._receive()
        except TimeoutError:
            detail = f"Nothing of the body arrived for {self._limits.pause:g} seconds; send it at one go."
            raise HTTPException(408, detail) from None
        size = len(message.get("body", b""))
        self._left -= size
        if self._left < 0:
            raise _too_large(self._limits.max_bytes)
        self._take(size)
        return message
