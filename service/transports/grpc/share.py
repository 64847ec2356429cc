"""What one call with several clouds has of the pool."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import ExitStack, asynccontextmanager

from service.engine.errors import Overloaded
from service.pool import Pool


class Share:
    """A place of the pool for each cloud of a call that is at work; where there is none, they wait for one another.

    Args:
        pool: where others take places too.
        kept: places that the call was admitted to before, and keeps: with one, none of its clouds is refused.
    """

    def __init__(self, pool: Pool, kept: int = 0) -> None:
        self._pool = pool
        self._kept = kept
        self._taken = 0
        self._given_back = asyncio.Condition()

    @asynccontextmanager
    async def place(self) -> AsyncIterator[None]:
        """A place for a cloud.

        Raises:
            Overloaded: there is none, and no other cloud of the call has one.
        """
        with ExitStack() as stack:
            while not self._take(stack):
                async with self._given_back:
                    await self._given_back.wait()
            try:
                yield
            finally:
                self._taken -= 1
                stack.close()
                async with self._given_back:
                    self._given_back.notify_all()

    def _take(self, stack: ExitStack) -> bool:
        if self._kept:
            self._kept -= 1
            stack.callback(self._keep)
        else:
            try:
                stack.enter_context(self._pool.admitted())
            except Overloaded:
                if not self._taken:
                    raise
                return False
        self._taken += 1
        return True

    def _keep(self) -> None:
        self._kept += 1
