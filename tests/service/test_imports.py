"""What a command does not need it does not import: that is most of the time that a command takes to start."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from service.transports.rest.examples import CLOUD_XYZ

ARRAYS = {"numba", "numpy", "pydantic", "scipy"}
SERVING = {"fastapi", "google.protobuf", "grpc", "prometheus_client", "starlette", "uvicorn", "zenoh"}
TRAINING = {"dask", "dbos", "joblib", "matplotlib", "open3d", "sapien", "sklearn", "sqlalchemy"}
FORMS = {"PIL", "rosbags", "scipy.ndimage", "scipy.spatial", "scipy.stats"}

HELP = """
import json, sys
import click
from {package}.cli import main

def ask(command, path):
    try:
        main([*path, "--help"], standalone_mode=False)
    except SystemExit:
        pass
    for name, below in getattr(command, "commands", {{}}).items():
        ask(below, [*path, name])

ask(main, [])
print("\\n" + json.dumps(sorted(sys.modules)))
"""

RESPOND = """
import json, sys
from service.cli import main
main(["respond", "--json", "--store", sys.argv[1], sys.argv[2]], standalone_mode=False)
print(json.dumps(sorted(sys.modules)))
"""


def imported(script: str, *arguments: str) -> set[str]:
    """The modules that a process has in the end, by the last line that it prints."""
    done = subprocess.run([sys.executable, "-c", script, *arguments], capture_output=True, text=True, check=True)
    return set(json.loads(done.stdout.splitlines()[-1]))


@pytest.mark.parametrize("package", ["service", "worker"])
def test_help_on_every_command_imports_no_library_of_arrays_and_nothing_that_serves_or_trains(package: str) -> None:
    modules = imported(HELP.format(package=package))
    assert f"{package}.cli" in modules
    assert not modules & (ARRAYS | SERVING | TRAINING | FORMS)


def test_an_answer_on_the_command_line_imports_nothing_that_serves_or_trains(tmp_path: Path) -> None:
    cloud = tmp_path / "cloud.xyz"
    cloud.write_text(CLOUD_XYZ)
    modules = imported(RESPOND, str(tmp_path / "store"), str(cloud))
    assert "service.engine.model" in modules
    assert not modules & (SERVING | TRAINING | FORMS)
