"""A job that is followed on the event loop."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator

from service.engine.errors import JobsUnavailable
from service.jobs import Look
from service.training import LOOK_EVERY, Following, Training


async def follow(training: Training, job_id: str, after: int = 0) -> AsyncIterator[Look | None]:
    """A job as it stands and the further lines of its log, until it is over or the service ends.

    A database that is out of reach for a while is waited for: whoever follows a job has time.

    Args:
        training: asked about the job.
        job_id: which one.
        after: number of the last line of the log that was seen.

    Yields:
        What is new, or None where nothing is.
    """
    following = Following(training, job_id, after)
    while not following.over and not training.ending.is_set():
        try:
            yield await asyncio.to_thread(following.look)
        except JobsUnavailable:
            yield None
        if not following.over:
            await asyncio.sleep(LOOK_EVERY)
