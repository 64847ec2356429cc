"""`shape-concepts watch`, as a process beside a robot."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import zenoh
from click.testing import CliRunner

from service.cli import main
from service.clouds import write_ply
from service.engine.cloud import PointCloud
from service.settings import Settings
from tests.service.transports.zenoh.conftest import Served, put


@contextmanager
def watching(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A process that watches, once it listens."""
    wide = os.environ | {"COLUMNS": "140"}
    command = [sys.executable, "-m", "service.cli", "watch", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=wide) as process:
        try:
            assert process.stderr is not None
            assert process.stderr.readline().startswith("listening to")
            yield process
        finally:
            process.kill()


def test_answers_and_problems_are_lines_of_json_until_ctrl_c(
    served: Served, endpoint: str, robot: zenoh.Session, clouds: list[PointCloud]
) -> None:
    served(streams=[{"key": "robots/*/cloud"}])
    with watching("robots/**", "--connect", endpoint, "--json") as process:
        assert process.stdout is not None
        lines = []
        for payload in (write_ply(clouds[0]), b"hello"):
            put(robot, "robots/7/cloud", payload)
            while "/concepts" not in (line := process.stdout.readline()):
                assert json.loads(line)["key"] == "robots/7/cloud"  # `**` brings the clouds as well
            lines.append(json.loads(line))
        process.send_signal(signal.SIGINT)
        assert process.wait(10) == 0
        assert process.stderr is not None
        assert process.stderr.read() == ""
    answer, error = lines
    assert answer["key"] == error["key"] == "robots/7/cloud/concepts"
    assert answer["answer"]["model"] == "tiny"
    assert answer["answer"]["source"]["key"] == "robots/7/cloud"
    assert error["error"]["type"] == "urn:shape-concepts:error:unsupported-format"


def test_a_table_is_shown_and_ends_after_a_number_of_answers(
    served: Served, endpoint: str, robot: zenoh.Session, clouds: list[PointCloud]
) -> None:
    served(streams=[{"key": "robots/*/cloud"}])
    with watching("robots/*/cloud/concepts", "--connect", endpoint, "--count", "1") as process:
        put(robot, "robots/7/cloud", write_ply(clouds[0]))
        output, _ = process.communicate(timeout=20)
        assert process.returncode == 0
    assert "best concept" in output
    assert "robots/7" in output


def test_it_says_what_keeps_it_from_watching(settings: Settings) -> None:
    for arguments, code, said in (
        (["a/b"], 2, "--connect"),
        (["a/b", "--connect", "tcp/127.0.0.1:1"], 1, "Unable to connect"),
        (["a/b", "--connect", "nonsense"], 1, "nonsense"),
    ):
        result = CliRunner().invoke(main, ["watch", *arguments])
        assert (result.exit_code, said in result.stderr) == (code, True), result.stderr
        assert "Traceback" not in result.stderr


def test_a_key_that_is_none_is_told(settings: Settings, endpoint: str) -> None:
    result = CliRunner().invoke(main, ["watch", "a//b", "--connect", endpoint])
    assert (result.exit_code, "a//b" in result.stderr) == (1, True), result.output
