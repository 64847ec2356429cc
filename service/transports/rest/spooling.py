"""Bodies that are too large for the memory: written to a file as they arrive."""

from __future__ import annotations

from typing import IO

from fastapi import Request
from fastapi.concurrency import run_in_threadpool

AT_ONCE = 2**20  # bytes that are written at a time, away from the event loop


async def receive_file(request: Request, file: IO[bytes]) -> int:
    """Writes the body of a request that `arriving` yields to a file; returns its length.

    Raises:
        OSError: the disk is full.
    """
    waiting, count = bytearray(), 0
    async for piece in request.stream():
        waiting += piece
        if len(waiting) >= AT_ONCE:
            count += await run_in_threadpool(file.write, bytes(waiting))
            waiting.clear()
    return count + await run_in_threadpool(file.write, bytes(waiting))
