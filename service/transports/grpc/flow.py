"""Many pieces of work of one call: a few at once, their results in order, and no more taken in than are sent out."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, AsyncIterator, Awaitable, Callable
from typing import TypeVar

A = TypeVar("A")
B = TypeVar("B")


async def in_order(
    coming: AsyncIterator[A], work: Callable[[A], Awaitable[B]], at_once: int
) -> AsyncGenerator[B, None]:
    """Works on what comes, and yields the results in the order in which it came.

    Args:
        coming: the next one is asked for only while fewer than `at_once` are at work or have a result that was not
            taken yet: whoever does not take results holds up what comes.
        work: done on each.
        at_once: how many.

    Raises:
        Exception: whatever `coming` or `work` raises, after the results of what came before.
    """
    places = asyncio.Semaphore(at_once)
    begun: asyncio.Queue[asyncio.Task[B] | None] = asyncio.Queue()
    tasks: set[asyncio.Task[B]] = set()

    async def begin() -> None:
        try:
            await places.acquire()
            async for piece in coming:
                task = asyncio.ensure_future(work(piece))
                tasks.add(task)
                begun.put_nowait(task)
                await places.acquire()
        finally:
            begun.put_nowait(None)

    beginning = asyncio.ensure_future(begin())
    try:
        while (task := await begun.get()) is not None:
            yield await task
            tasks.discard(task)
            places.release()
        await beginning
    finally:
        for left in (beginning, *tasks):
            left.cancel()
        await asyncio.gather(beginning, *tasks, return_exceptions=True)
