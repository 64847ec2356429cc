"""Waits for what happens in other threads and processes."""

from __future__ import annotations

import time
from collections.abc import Callable


def until(happened: Callable[[], object], what: str, seconds: float = 15) -> None:
    """Returns when it has happened; fails when it does not."""
    end = time.monotonic() + seconds
    while not happened():
        assert time.monotonic() < end, f"not within {seconds} s: {what}"
        time.sleep(0.02)
