"""Progress of long work, for people: a bar at a terminal, a line a stage elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

Item = TypeVar("Item")
LINE_EVERY = 10.0  # seconds between two lines of a count, where there is no terminal


class Watch:
    """Tells on stderr which stage is under way, and how far it is."""

    def __init__(self, progress: Progress | None) -> None:
        self._progress = progress
        self._task = progress.add_task("", total=None) if progress else None
        self._stage = ""

    def stage(self, name: str) -> None:
        """Says that a stage begins."""
        self._stage = name
        if self._progress and self._task is not None:
            self._progress.reset(self._task, total=None, description=name)
        else:
            print(f"{name} ...", file=sys.stderr, flush=True)

    def count(self, items: Iterable[Item], total: int) -> Iterator[Item]:
        """Hands items on and counts them."""
        last = time.monotonic()
        if self._progress and self._task is not None:
            self._progress.update(self._task, total=total, completed=0)
        for number, item in enumerate(items, start=1):
            yield item
            if self._progress and self._task is not None:
                self._progress.update(self._task, completed=number)
            elif time.monotonic() - last > LINE_EVERY:
                last = time.monotonic()
                print(f"{self._stage}: {number} of {total}", file=sys.stderr, flush=True)


@contextmanager
def watching() -> Iterator[Watch]:
    """A `Watch` for as long as the work takes."""
    if not sys.stderr.isatty():
        yield Watch(None)
        return
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description:<28}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        yield Watch(progress)
