"""Bodies of HTTP requests as they arrive: never more than the limit is read, and never waited for without end."""

from __future__ import annotations

import asyncio
import io
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import NamedTuple

from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.types import Message

from service.access import Caller
from service.engine.errors import Cancelled, ContentTooLarge
from service.settings import Settings


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


def limits_of(settings: Settings, caller: Caller) -> Limits:
    """What the settings allow to a caller."""
    return Limits(caller.max_body, settings.body_timeout, settings.body_pause)


@asynccontextmanager
async def arriving(request: Request, limits: Limits, take: Callable[[int], None]) -> AsyncIterator[Request]:
    """Yields a request whose body can be read within limits.

    Args:
        request: of which nothing was read yet.
        limits: on the body.
        take: called with the number of bytes as they arrive; may raise `Overloaded`.

    Raises:
        Cancelled: the client hung up.
        ContentTooLarge: the body is larger than the limit.
        HTTPException: 408, it did not arrive in time.
    """
    _check_announced(request, limits.max_bytes)
    try:
        async with asyncio.timeout(limits.timeout):
            yield Request(request.scope, _Limited(request, limits, take))
    except TimeoutError:
        raise HTTPException(408, f"The body did not arrive within {limits.timeout:g} seconds.") from None
    except ClientDisconnect:
        raise Cancelled("The client hung up before its request had arrived.") from None


async def whole(request: Request) -> bytes:
    """The body of a request that `arriving` yields.

    It grows where it is to stay: to join a hundred megabytes in the end would keep the event loop from everybody else.
    """
    body = io.BytesIO()
    async for piece in request.stream():
        body.write(piece)
    return body.getvalue()


def _check_announced(request: Request, max_bytes: int) -> None:
    announced = request.headers.get("content-length", "")
    if announced.isdecimal() and int(announced) > max_bytes:
        raise _too_large(max_bytes)


def _too_large(max_bytes: int) -> ContentTooLarge:
    return ContentTooLarge(
        f"The body is larger than the {max_bytes} bytes that are taken. Send fewer points, or a binary format."
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
