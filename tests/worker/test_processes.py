"""Processes that are prepared give what others give, and end with the one that asked for them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

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
