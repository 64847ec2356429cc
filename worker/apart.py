"""A stage of a job in a process of its own, which can be ended at any moment, whatever it computes.

The process has a session of its own, and everything that it starts (joblib's processes) is in it: one signal ends them
all. They also end when whoever started them does, however that ends.
"""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from multiprocessing import forkserver
from multiprocessing.connection import Connection, wait
from typing import Any, NamedTuple, TypeVar

from service.engine import errors
from service.engine.errors import ShapeConceptsError, StageDied

Result = TypeVar("Result")
Item = TypeVar("Item")
LOOK_EVERY = 0.2  # seconds between two looks whether the work is still wanted
COUNT_EVERY = 0.2  # seconds between two reports of a count
END_WAIT = 5.0  # seconds that processes have to end once they are told
_CONTEXT = multiprocessing.get_context("forkserver")  # a fork of a process with threads may hang


class Count(NamedTuple):
    """How far a stage is.

    Attributes:
        stage: its name.
        done: pieces.
        total: pieces; None where that is not known.
    """

    stage: str
    done: int
    total: int | None


class Unexpected(Exception):
    """Something that was not foreseen went wrong in the other process; the text is its traceback."""


class Telling:
    """How the work in the process tells of itself; made for `Watch`'s place."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._stage, self._told = "", 0.0

    def stage(self, name: str, total: int | None = None) -> None:
        """Says that a stage begins."""
        self._stage, self._told = name, time.monotonic()
        self._connection.send(Count(name, 0, total))

    def count(self, items: Iterable[Item], total: int) -> Iterator[Item]:
        """Hands items on and counts them."""
        for number, item in enumerate(items, start=1):
            yield item
            if time.monotonic() - self._told > COUNT_EVERY or number == total:
                self._told = time.monotonic()
                self._connection.send(Count(self._stage, number, total))

    def log(self, line: str) -> None:
        """Writes a line to the job's log."""
        self._connection.send(line)


def preload() -> None:
    """Has what stages need imported once, for all of them."""
    _CONTEXT.set_forkserver_preload(["worker.job_steps"])
    forkserver.ensure_running()


def run_apart(
    work: Callable[..., Result],
    arguments: tuple[Any, ...],
    tell: Callable[[Count | str], None],
    look: Callable[[], None],
) -> Result:
    """The result of a function that runs in a process of its own.

    Args:
        work: a function of a module; called with a `Telling` and the arguments.
        arguments: can be pickled.
        tell: called with what the work tells.
        look: called several times a second; when it raises, the process and all that it started are ended.

    Raises:
        ShapeConceptsError: whatever the work raises of that.
        StageDied: the process ended without a result.
        Unexpected: the work raised anything else.
        BaseException: whatever `look` and `tell` raise.
    """
    ours, theirs = _CONTEXT.Pipe()
    folder = tempfile.mkdtemp(prefix="shape-concepts-job-")
    process = _CONTEXT.Process(target=_begin, args=(work, arguments, theirs, folder))
    process.start()
    theirs.close()
    try:
        while True:
            look()
            if not ours.poll(LOOK_EVERY):
                continue
            message = ours.recv()
            if isinstance(message, Count | str):
                tell(message)
            elif message[0] == "result":
                result: Result = message[1]
                return result
            else:
                raise _error(*message[1:])
    except (EOFError, ConnectionResetError):
        process.join(END_WAIT)
        code = process.exitcode or 0
        how = f"by signal {-code} ({signal.Signals(-code).name})" if code < 0 else f"with exit code {code}"
        raise StageDied(
            f"The process at work ended {how} without a result. Most likely it was killed for want of memory: give it "
            "more, or fewer processes (--workers), or fewer clouds."
        ) from None
    finally:
        _end(process)
        ours.close()
        shutil.rmtree(folder, ignore_errors=True)


def _end(process: Any) -> None:
    """Ends a process and everything of its session; what clears up after them takes no notice, and does its work."""
    try:
        os.killpg(process.pid, signal.SIGTERM)
    except ProcessLookupError:  # it has ended, or has no session of its own yet
        process.terminate()
    process.join(END_WAIT)
    if process.is_alive():
        process.kill()
        process.join()


def _begin(work: Callable[..., Any], arguments: tuple[Any, ...], connection: Connection, folder: str) -> None:
    """What the process does; its temporary files are in the folder."""
    os.setsid()
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    os.environ["TMPDIR"] = tempfile.tempdir = folder
    threading.Thread(target=_end_with_parent, args=[folder], daemon=True).start()
    try:
        message: tuple[Any, ...] = ("result", work(Telling(connection), *arguments))
    except ShapeConceptsError as error:
        message = ("error", type(error).__name__, str(error))
    except BaseException:
        message = ("error", "", traceback.format_exc())
    with suppress(BrokenPipeError):
        connection.send(message)
    connection.close()


def _end_with_parent(folder: str) -> None:
    """Waits for the end of whoever wants the result, and then ends this session."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    wait([parent.sentinel])
    shutil.rmtree(folder, ignore_errors=True)
    os.killpg(0, signal.SIGTERM)


def _error(name: str, said: str) -> Exception:
    known = getattr(errors, name, None) if name else None
    return known(said) if known else Unexpected(said)
