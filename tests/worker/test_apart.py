"""Work in a process of its own: its result, its errors, and its end, whoever wants it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import pytest

from service.engine.errors import NotEnoughSamples, StageDied
from worker.apart import Count, Telling, Unexpected, run_apart


class GivenUp(BaseException):
    pass


def nothing(*_: object) -> None:
    pass


def tell_and_add(tell: Telling, a: int, b: int) -> int:
    tell.stage("adding", 3)
    for _ in tell.count(range(3), 3):
        pass
    tell.log("added")
    return a + b


def refuse(tell: Telling) -> None:
    raise NotEnoughSamples("one is not enough")


def fail(tell: Telling) -> None:
    raise ZeroDivisionError("unforeseen")


def die(tell: Telling) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def sleep_beside_a_child(tell: Telling, folder: str) -> None:
    """As long work that holds the interpreter, with a process of its own."""
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    Path(tempfile.mkdtemp(), "left behind").touch()
    Path(folder, "pids").write_text(f"{os.getpid()} {child.pid} {tempfile.gettempdir()}")
    tell.log("asleep")
    time.sleep(600)


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def wait_for_the_end(pids: list[int]) -> None:
    until = time.monotonic() + 20
    while any(alive(pid) for pid in pids):
        assert time.monotonic() < until, f"{pids} live on"
        time.sleep(0.05)


def test_the_result_and_what_is_told_arrive_in_order() -> None:
    told: list[Count | str] = []
    assert run_apart(tell_and_add, (2, 3), told.append, nothing) == 5
    assert told[0] == Count("adding", 0, 3)
    assert told[-2:] == [Count("adding", 3, 3), "added"]


def test_an_error_of_ours_is_the_same_on_this_side() -> None:
    with pytest.raises(NotEnoughSamples, match="one is not enough"):
        run_apart(refuse, (), nothing, nothing)


def test_what_was_not_foreseen_comes_with_its_traceback() -> None:
    with pytest.raises(Unexpected, match=r"(?s)in fail.*unforeseen"):
        run_apart(fail, (), nothing, nothing)


def test_a_process_that_was_killed_is_told_from_one_that_failed() -> None:
    with pytest.raises(StageDied, match="SIGKILL"):
        run_apart(die, (), nothing, nothing)


def test_work_that_is_not_wanted_ends_at_once_with_all_that_it_started(tmp_path: Path) -> None:
    told: list[Count | str] = []

    def look() -> None:
        if told:
            raise GivenUp

    with pytest.raises(GivenUp):
        run_apart(sleep_beside_a_child, (str(tmp_path),), told.append, look)
    *pids, folder = (tmp_path / "pids").read_text().split()
    wait_for_the_end([int(pid) for pid in pids])
    assert not Path(folder).exists()


def test_work_ends_with_whoever_wanted_it_even_by_a_kill(tmp_path: Path) -> None:
    program = (
        "from tests.worker.test_apart import *\n"
        f"run_apart(sleep_beside_a_child, ({str(tmp_path)!r},), lambda said: print(said, flush=True), nothing)"
    )
    wanting = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    try:
        assert wanting.stdout is not None
        assert wanting.stdout.readline() == "asleep\n"
    finally:
        wanting.kill()
        wanting.communicate()
    *pids, folder = (tmp_path / "pids").read_text().split()
    try:
        wait_for_the_end([int(pid) for pid in pids])
        assert not Path(folder).exists()
    finally:
        for pid in pids:
            with suppress(ProcessLookupError):
                os.kill(int(pid), signal.SIGKILL)
