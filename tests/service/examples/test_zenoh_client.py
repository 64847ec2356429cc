"""The example of zenoh, run as its docstring says, against a service that listens."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from service.application import Application
from service.clouds import write_ply
from service.engine.cloud import PointCloud
from service.settings import Settings
from tests.conftest import ROOT
from tests.service.transports.zenoh.conftest import running
from tests.service.transports.zenoh.router import free_endpoint
from tests.service.transports.zenoh.test_queries import dented_ball


@pytest.fixture
def endpoint(settings: Settings) -> Iterator[str]:
    """Where a service listens, without a router."""
    endpoint = free_endpoint()
    more = {"zenoh_listen": endpoint, "streams": [{"key": "robots/*/cloud"}]}
    application = Application(Settings(**settings.model_dump() | more))
    with running(application):
        yield endpoint
    application.close()


def run(endpoint: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(ROOT / "service/examples/zenoh_client.py"), "--connect", endpoint, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


def test_it_asks_and_publishes(endpoint: str, clouds: list[PointCloud], tmp_path: Path) -> None:
    file = tmp_path / "mug.ply"
    file.write_bytes(write_ply(clouds[0]))
    asked = run(endpoint, "ask", str(file), "--model", "tiny")
    assert (asked.returncode, "1. concept" in asked.stdout) == (0, True), asked.stderr
    published = run(endpoint, "publish", str(file), "--count", "3")
    assert (published.returncode, "cloud 2" in published.stdout) == (0, True), published.stderr


def test_it_asks_about_a_depth_image_within_its_mask(endpoint: str, tmp_path: Path) -> None:
    image, mask, params = dented_ball()
    (tmp_path / "depth.npy").write_bytes(image)
    (tmp_path / "mask.npy").write_bytes(mask)
    asking = ["ask", str(tmp_path / "depth.npy"), "--model", "tiny", "--intrinsics", params["intrinsics"]]
    whole, masked = run(endpoint, *asking), run(endpoint, *asking, "--mask", str(tmp_path / "mask.npy"))
    responses = [re.findall(r"response (\S+)", each.stdout) for each in (whole, masked)]
    assert len(responses[0]) == len(responses[1]) == 3, (whole, masked)
    assert responses[0] != responses[1]


def test_it_says_why_there_is_no_answer(endpoint: str, tmp_path: Path) -> None:
    file = tmp_path / "mug.ply"
    file.write_bytes(b"ply\n")
    for arguments in (["ask", str(file), "--model", "tiny"], ["publish", str(file), "--count", "1"]):
        assert "The cloud cannot be read" in run(endpoint, *arguments).stdout
