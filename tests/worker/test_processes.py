"""Processes that are prepared give what others give, and end with the one that asked for them."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

PROGRAM = """
import sys
from worker.processes import prepare

if __name__ == "__main__":
    if sys.argv[1] == "prepared":
        prepare("raycast")
    from joblib import Parallel, delayed, parallel_config
    from service.engine.params import ModelParams
    from tests.learnt import SIMULATION
    from worker.learning.observations import observe
    from worker.sources import Simulation

    with parallel_config(backend="loky", n_jobs=2):
        for seen in observe(Simulation(8, 3, SIMULATION).unmade(), ModelParams()):
            print(seen.key, seen.digest, seen.descriptors.tobytes().hex()[:64])
"""


def test_prepared_processes_see_what_others_see(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    said = [
        subprocess.run(
            [sys.executable, str(program), how],
            capture_output=True,
            text=True,
            check=True,
            timeout=120,
            env=environment,
        )
        for how in ("prepared", "not")
    ]
    assert said[0].stdout == said[1].stdout
    assert said[0].stdout.count("\n") == 8
    assert said[0].stderr == ""


WAITING = """
import os, sys, time
from worker.processes import prepare
from worker.sharing import shared_out

def tell(_):
    print(os.getpid(), flush=True)
    time.sleep(600)

if __name__ == "__main__":
    if sys.argv[1] == "prepared":
        prepare("raycast")
    from joblib import Parallel, delayed

    with shared_out(2):
        Parallel()(delayed(tell)(number) for number in range(2))
"""


def lives(pid: int) -> bool:
    """Whether a process is there and not merely unburied."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


@pytest.mark.skipif(not hasattr(os, "pidfd_open"), reason="only Linux tells of any process that it has ended")
@pytest.mark.parametrize("how", ["prepared", "not"])
def test_processes_end_with_the_one_they_work_for_even_if_it_is_killed(tmp_path: Path, how: str) -> None:
    program = tmp_path / "program.py"
    program.write_text(WAITING)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, str(program), how]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=environment) as killed:
        assert killed.stdout is not None
        pids = [int(killed.stdout.readline()) for _ in range(2)]
        killed.kill()
        until = time.monotonic() + 20
        while any(lives(pid) for pid in pids):
            assert time.monotonic() < until, f"{pids} live on"
            time.sleep(0.05)
