"""Work on an HTTP request for as long as its client is there."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

from starlette.requests import Request

from service.engine.errors import Cancelled

T = TypeVar("T")


async def while_connected(request: Request, work: Coroutine[Any, Any, T]) -> T:
    """The result of work for a request; when its client hangs up, the work is cancelled.

    Args:
        request: whose body was received.
        work: may go on a little to end in good order when it is cancelled; it is waited for.

    Raises:
        Cancelled: the client hung up before the work was done.
        Exception: whatever the work raises.
    """
    working, leaving = asyncio.ensure_future(work), asyncio.ensure_future(_hung_up(request))
    try:
        await asyncio.wait({working, leaving}, return_when=asyncio.FIRST_COMPLETED)
        if working.done():
            return working.result()
        raise Cancelled("The client hung up before it had its answer; the work was ended.")
    finally:
        working.cancel()
        leaving.cancel()
        await asyncio.gather(working, leaving, return_exceptions=True)


async def _hung_up(request: Request) -> None:
    """Waits for the client to hang up: of a request that was received, nothing else is left to come."""
    while (await request.receive())["type"] != "http.disconnect":
        pass
