"""A progress bar with the name of the stage, for people at a terminal."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

LONG = 3.0  # seconds after which silence is worth a word


@contextmanager
def watched(name: str, number: int, total: int, excuse: str = "") -> Iterator[Callable[[str], None]]:
    """A bar on stderr while one of several pieces of work is done; nearly silent where stderr is no terminal.

    Args:
        name: of this piece.
        number: how many were done before.
        total: how many there are.
        excuse: said once where stderr is no terminal and the first piece takes long.

    Yields:
        What is to be called with the name of each stage as it begins.
    """
    if not sys.stderr.isatty():
        long = threading.Timer(LONG, lambda: print(f"{name}: {excuse}", file=sys.stderr, flush=True))
        if excuse and number == 0:
            long.start()
        try:
            yield lambda stage: None
        finally:
            long.cancel()
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    columns = (BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}", markup=False))
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, redirect_stdout=False, redirect_stderr=False) as progress:
        task = progress.add_task(name, total=total, completed=number)
        yield lambda stage: progress.update(task, description=f"{name}: {stage}")
