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
from service.clouds.claims import quote
from service.engine.errors import Cancelled, UnreadableCloud

FIELD = "cloud"
MASK = "mask"


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


class Received(NamedTuple):
    """What a request brought.

    Attributes:
        data: the bytes of the cloud's file.
        format: of the cloud; None where the content has to tell.
        name: of the file, "" for none.
        mask: the file of a depth image's mask, if there was one.
    """

    data: bytes
    format: str | None = None
    name: str = ""
    mask: bytes | None = None


async def receive_cloud(request: Request, limits: Limits, take: Callable[[int], None]) -> Received:
    """Receives the file of a request.

    Args:
        request: with the file as its body, or with a form that has it in the field `cloud`, and may have another in
            the field `mask`.
        limits: on the body.
        take: called with the number of bytes as they arrive; may raise `Overloaded`.

    Raises:
        UnsupportedFormat: the media type is not that of a cloud.
        UnreadableCloud: the form is malformed, has no such field, or other files.
        Cancelled: the client hung up.
        HTTPException: 413, the body is larger than the limit; 408, it did not arrive in time.
    """
    media_type = request.headers.get("content-type", "")
    form = media_type.partition(";")[0].strip().lower() == "multipart/form-data"
    format = None if form else by_media_type(media_type)
    async with arriving(request, limits, take) as limited:
        if form:
            return await _from_form(limited)
        return Received(await limited.body(), format)


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


async def _from_form(request: Request) -> Received:
    try:
        async with request.form(max_files=2, max_fields=8) as form:
            parts = [(name, part) for name, part in form.multi_items() if isinstance(part, UploadFile) or name == MASK]
            files = {name: part for name, part in parts if isinstance(part, UploadFile)}
            if FIELD not in files:
                raise UnreadableCloud(f"The form has no file in the field '{FIELD}': send it with -F {FIELD}=@FILE.")
            if len(files) < len(parts) or not files.keys() <= {FIELD, MASK}:
                raise UnreadableCloud(
                    f"The form has the fields {quote([name for name, _ in parts])}: it should have one file in "
                    f"'{FIELD}' and, for a depth image, may have one in '{MASK}'."
                )
            cloud = files[FIELD]
            mask = await files[MASK].read() if MASK in files else None
            return Received(await cloud.read(), by_media_type(cloud.content_type or ""), cloud.filename or "", mask)
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
