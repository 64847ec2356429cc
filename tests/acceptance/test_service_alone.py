"""The service as an image has it: without the worker, and without what only the worker needs."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

from joblib import parallel_config

from service.clouds import write_ply
from service.engine.params import ModelParams
from service.store import ModelStore
from tests.conftest import ROOT
from worker.learning.train import train
from worker.sources import Simulation, SimulationParams

ABSENT = ("worker", "sapien", "open3d", "sklearn", "joblib", "threadpoolctl", "dbos")
RESPOND = f"""
import sys
from importlib.abc import MetaPathFinder

class Absent(MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {ABSENT}:
            raise ModuleNotFoundError(f"there is no {{name}} here", name=name)

sys.meta_path.insert(0, Absent())
from service.cli import main
main()
"""


def test_a_cloud_is_answered_where_there_is_no_worker(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "service", tmp_path / "alone" / "service", ignore=shutil.ignore_patterns("__pycache__"))
    source = Simulation(6, 4, SimulationParams(renderer="raycast"))
    clouds = list(source)
    with parallel_config(backend="sequential"):
        model, _ = train(clouds, ModelParams())
    ModelStore(str(tmp_path / "store")).publish(model, name="m", seed=0, source=source.describe())
    file = tmp_path / "cloud.ply"
    file.write_bytes(write_ply(clouds[0].cloud))

    arguments = ("respond", "--json", "--model", "m", "--store", str(tmp_path / "store"), str(file))
    answered = subprocess.run(
        [sys.executable, "-c", RESPOND, *arguments],
        cwd=tmp_path / "alone",
        env=os.environ | {"PYTHONPATH": str(tmp_path / "alone"), "PYTHONSAFEPATH": "1"},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert answered.returncode == 0, answered.stderr
    assert json.loads(answered.stdout)["responses"] == model.respond(clouds[0].cloud).responses.tolist()
