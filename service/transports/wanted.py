"""Work on the pool for as long as somebody waits for it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TypeVar

from service.engine.errors import Cancelled
from service.engine.model import OnStage
from service.pool import Pool

T = TypeVar("T")


async def run_while_wanted(pool: Pool, work: Callable[[OnStage], T]) -> T:
    """The result of work done on the pool; when the caller is cancelled, the work ends with the stage that it is at.

    Work that has not begun is dropped.

    Args:
        pool: which the caller has been admitted to.
        work: is given what it calls as each stage begins.

    Raises:
        Exception: whatever the work raises.
    """
    wanted = True

    def go_on(stage: str) -> None:
        if not wanted:
            raise Cancelled(f"The client hung up, or its deadline passed; the work ended before {stage}.")

    def begin() -> T:
        go_on("it began")
        return work(go_on)

    begun = pool.begin(begin)
    try:
        return await begun.result
    except asyncio.CancelledError:
        wanted = False
        await begun.end()  # its place is free when its thread is
        raise
