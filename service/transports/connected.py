"""Work on an HTTP request for as long as its client is there."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

from starlette.requests import Request

from service.engine.errors import Cancelled

T = TypeVar("T")

GLANCE = 0.05  # seconds of work in which nobody looks whether the client is there: most is done by then, for less


async def while_connected(request: Request, work: Coroutine[Any, Any, T]) -> T:
    """The result of work for a request; when its client hangs up, the work is cancelled.

    Args:
        request: whose body was received.
        work: may go on a little to end in good order when it is cancelled; it is waited for.

    Raises:
        Cancelled: the client hung up before the work was done.
        Exception: whatever the work raises.
    """
    task = asyncio.current_task()
    assert task is not None
    watching: asyncio.Task[None] | None = None
    left = False

    async def watch() -> None:
        nonlocal left
        while (await request.receive())["type"] != "http.disconnect":
            pass  # of a request that was received, nothing else is left to come
        left = True
        task.cancel()

    def begin() -> None:
        nonlocal watching
        watching = asyncio.ensure_future(watch())

    timer = asyncio.get_running_loop().call_later(GLANCE, begin)
    try:
        return await work
    except asyncio.CancelledError:
        if left and task.uncancel() == 0:
            raise Cancelled("The client hung up before it had its answer; the work was ended.") from None
        raise
    finally:
        timer.cancel()
        if watching is not None:
            watching.cancel()
