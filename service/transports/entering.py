"""The gate before every request: asked at once where it knows, and on a thread where it may have to ask the store."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import ExitStack, asynccontextmanager

from service.access import Caller, Gate
from service.scopes import Scope


@asynccontextmanager
async def entered(gate: Gate, key: str | None, *scopes: Scope) -> AsyncIterator[Caller]:
    """The caller, for as long as the request is under way; as `Gate.entered`, for an event loop.

    Raises:
        NotAuthenticated, NotAllowed, RateExceeded: by the gate.
    """
    entering = gate.entered(key, *scopes)
    if gate.at_hand:
        with entering as caller:
            yield caller
        return
    with ExitStack() as stack:
        asking = asyncio.ensure_future(asyncio.to_thread(stack.enter_context, entering))
        try:
            caller = await asyncio.shield(asking)
        except asyncio.CancelledError:
            await asyncio.gather(asking, return_exceptions=True)  # who enters late leaves as well
            raise
        yield caller


def key_in(authorization: str) -> str | None:
    """The access key in what a client sends as its authorization, "Bearer KEY"; None for none."""
    kind, _, key = authorization.partition(" ")
    return key.strip() if kind.lower() == "bearer" else None
