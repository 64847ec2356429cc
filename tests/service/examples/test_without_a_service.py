"""Examples that find no service say so in a line."""

from __future__ import annotations

import socket
import subprocess
import sys
from pathlib import Path

import pytest

from service.clouds import write_ply
from tests.conftest import ROOT
from tests.learnt import named_clouds


@pytest.mark.parametrize("name", ["rest_client", "grpc_client", "zenoh_client"])
def test_it_is_said_whom_was_asked_in_vain(tmp_path: Path, name: str) -> None:
    (tmp_path / "mug.ply").write_bytes(write_ply(named_clouds()[0].cloud))
    with socket.create_server(("127.0.0.1", 0)) as free:
        place = f"127.0.0.1:{free.getsockname()[1]}"
    arguments = {
        "rest_client": ["--address", f"http://{place}", "mug.ply"],
        "grpc_client": ["--address", place, "mug.ply"],
        "zenoh_client": ["--connect", f"tcp/{place}", "ask", "mug.ply"],
    }[name]
    command = [sys.executable, "-m", f"service.examples.{name}", *arguments]
    run = subprocess.run(
        command, cwd=tmp_path, env={"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, timeout=60
    )
    assert (run.returncode, run.stdout) == (1, "")
    assert place in run.stderr
    assert "Traceback" not in run.stderr
    assert len(run.stderr.splitlines()) == 1
