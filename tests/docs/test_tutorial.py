"""The tutorial: its commands, taken out of the page and run in a real shell, on fewer objects."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from service.store import ModelStore
from tests.conftest import ROOT

PAGE = ROOT / "docs" / "tutorial.md"
LONGEST = 400  # seconds
FEWER = {  # what the page says, and what is run
    "--count 20 ": "--count 6 --renderer raycast ",
    "--simulate 250 ": "--simulate 12 --renderer raycast ",
}
needs_curl = pytest.mark.skipif(shutil.which("curl") is None, reason="curl is not installed")


def blocks(page: Path) -> list[str]:
    """The shell commands of a page, a block each."""
    return re.findall(r"^```sh\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE)


def commands_in(folder: Path) -> Path:
    """A folder with our commands as they are in this tree, to be put before others in PATH."""
    for name, module in (("shape-concepts", "service.cli"), ("shape-concepts-worker", "worker.cli")):
        command = folder / name
        command.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m {module} "$@"\n')
        command.chmod(0o755)
    return folder


def shell(script: str, folder: Path, environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    """Runs commands in bash, in a folder; none of their processes outlives it."""
    command = ["bash", "-euo", "pipefail", "-c", script]
    with subprocess.Popen(
        command,
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            said, complained = process.communicate(timeout=LONGEST)
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
    return subprocess.CompletedProcess(command, process.returncode, said, complained)


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, subprocess.CompletedProcess[str]]:
    """The folder in which the tutorial was done, and how its commands went."""
    folder, commands = tmp_path_factory.mktemp("tutorial"), commands_in(tmp_path_factory.mktemp("bin"))
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    script = "\n".join(blocks(PAGE)).replace("localhost:8000", f"localhost:{port}")
    for said, instead in FEWER.items():
        assert said in script
        script = script.replace(said, instead)
    environment = {name: value for name, value in os.environ.items() if not name.startswith("SHAPE_CONCEPTS_")} | {
        "PATH": f"{commands}:{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "COLUMNS": "120",
        "SHAPE_CONCEPTS_PORT": str(port),
        "SHAPE_CONCEPTS_GRPC_PORT": "-1",
    }
    run = shell(f"{script}\nwait", folder, environment)
    return folder / "workshop", run


@needs_curl
@pytest.mark.slow
class TestEveryCommandRuns:
    """As somebody would type them, one after the other."""

    def test_to_the_end(self, done: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
        _, run = done
        assert run.returncode == 0, run.stdout + run.stderr

    def test_the_model_learnt_from_the_scans_and_from_simulated_objects(
        self, done: tuple[Path, subprocess.CompletedProcess[str]]
    ) -> None:
        folder, _ = done
        manifest = ModelStore(folder / "store").manifest("workshop", 1)
        assert manifest.counts["objects"] == 2 * 6 + 12
        assert manifest.job == "first"

    def test_the_service_answers_with_the_names_that_were_given(
        self, done: tuple[Path, subprocess.CompletedProcess[str]]
    ) -> None:
        _, run = done
        (line,) = [line for line in run.stdout.splitlines() if line.startswith("{")]
        (concept,) = json.loads(line)["concepts"]
        assert concept["name"] in ("my first concept", "simple", "tangled")
        assert f"Concept {concept['id']} of workshop:1 is called my first concept now." in run.stdout

    def test_both_pictures_are_there_and_the_second_one_asks_the_new_model(
        self, done: tuple[Path, subprocess.CompletedProcess[str]]
    ) -> None:
        folder, _ = done
        assert '"model": "default"' in (folder / "first.html").read_text()
        assert '"model": "workshop"' in (folder / "again.html").read_text()

    def test_the_labels_are_those_of_the_folders(self, done: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
        folder, _ = done
        lines = (folder / "scans" / "labels.csv").read_text().splitlines()
        assert lines[0] == "file,category"
        assert len(lines) == 1 + 2 * 6
        assert "simple/0000-order1.ply,simple" in lines
