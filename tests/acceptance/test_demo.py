"""The demo, as `./run demo` runs it, on fewer objects."""

from __future__ import annotations

import re
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT

OBJECTS = 15


def demo(folder: Path, *files: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "worker.demo", "--count", str(OBJECTS), "--folder", str(folder), *map(str, files)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=600)


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    """A folder with the demo's model, and how its first run went."""
    folder = tmp_path_factory.mktemp("demo") / "a folder"
    return folder, demo(folder)


def refuses_connections(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) != 0


def test_the_demo_learns_publishes_asks_and_lists_concepts_best_first(first):
    _, run = first
    assert run.returncode == 0, run.stderr
    assert "Published demo:1 (demo@production): " in run.stdout
    assert "curl" in run.stdout
    assert "/v1/responses?model=demo" in run.stdout
    assert re.search(r"│ +1 │ +\d+ │", run.stdout)


def test_the_service_is_stopped_at_the_end(first):
    _, run = first
    (port,) = re.findall(r"--port (\d+)", run.stdout)
    assert refuses_connections(int(port))


def test_a_second_run_learns_nothing_again(first):
    folder, _ = first
    run = demo(folder)
    assert run.returncode == 0, run.stderr
    assert " train " not in run.stdout
    assert " simulate " not in run.stdout
    assert re.search(r"│ +1 │ +\d+ │", run.stdout)


def test_your_own_clouds_are_asked_about_and_a_bad_one_is_refused_by_the_service(first, tmp_path):
    folder, _ = first
    good = next(folder.rglob("*.ply"))
    bad = tmp_path / "bad.pcd"
    bad.write_bytes(b"# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\n")
    run = demo(folder, bad, good)
    assert run.returncode == 1
    assert re.search(r"^4\d\d .+: .+", run.stderr, re.MULTILINE)
    assert re.search(r"│ +1 │ +\d+ │", run.stdout)
    (port,) = re.findall(r"--port (\d+)", run.stdout)
    assert refuses_connections(int(port))


def test_an_interrupted_demo_goes_on_and_a_damaged_model_is_said(first, tmp_path):
    folder = tmp_path / "demo"
    (folder / "unseen").mkdir(parents=True)
    shutil.copytree(first[0] / "store", folder / "store")
    assert demo(folder).returncode == 0
    (content,) = (folder / "store").rglob("*.safetensors")
    content.write_bytes(content.read_bytes()[:-100])
    run = demo(folder)
    assert run.returncode == 1
    assert "not ready" in run.stderr


def test_a_file_that_is_not_there_is_said_before_anything_is_done(tmp_path):
    run = demo(tmp_path / "demo", "nowhere.ply")
    assert run.returncode == 2
    assert "nowhere.ply" in run.stderr
    assert not (tmp_path / "demo").exists()
