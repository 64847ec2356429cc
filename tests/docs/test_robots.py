"""The page for robots: its commands in a real shell, its program, its streams and keys."""

from __future__ import annotations

import json
import os
import re
import shlex
import socket
import sys
from pathlib import Path

import pytest
import zenoh
from pydantic import TypeAdapter

from service.clouds import write_ply
from service.streams import Stream
from service.transports.zenoh.encodings import format_of_key
from tests.conftest import ROOT
from tests.docs.test_tutorial import blocks, commands_in, shell
from tests.learnt import named_clouds

PAGE = ROOT / "docs" / "robots.md"
STREAMS = re.findall(r"SHAPE_CONCEPTS_STREAMS='(\[.*?\])'", PAGE.read_text(), re.DOTALL)


@pytest.mark.slow
def test_a_robot_is_answered_as_the_page_says(tmp_path: Path) -> None:
    (tmp_path / "mug.ply").write_bytes(write_ply(named_clouds()[0].cloud))
    with socket.create_server(("127.0.0.1", 0)) as free:
        endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    program = re.search(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert program is not None
    (tmp_path / "publish.py").write_text(program[1].replace("tcp/ROUTER:7447", endpoint))
    (tmp_path / "python").write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} "$@"\n')
    (tmp_path / "python").chmod(0o755)
    example = f"{ROOT}/service/examples/zenoh_client.py"
    script = blocks(PAGE)[0].replace("tcp/127.0.0.1:7447", endpoint)
    script = script.replace("service/examples/zenoh_client.py", f"{shlex.quote(example)} --connect {endpoint}")
    script = script.replace("shape-concepts watch", "shape-concepts watch --json")
    environment = {name: value for name, value in os.environ.items() if not name.startswith("SHAPE_CONCEPTS_")} | {
        "PATH": f"{tmp_path}:{commands_in(tmp_path)}:{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "SHAPE_CONCEPTS_PORT": "0",
        "SHAPE_CONCEPTS_GRPC_PORT": "-1",
        "SHAPE_CONCEPTS_STORE": str(tmp_path / "store"),
    }
    run = shell(f"{script}\nwait $!\necho PROGRAM\npython publish.py\nkill %1\nwait", tmp_path, environment)
    assert run.returncode == 0, run.stdout + run.stderr
    watched = [json.loads(line) for line in run.stdout.splitlines() if line.startswith('{"key"')]
    assert [line["key"] for line in watched] == ["robots/9/cloud/concepts"] * 3
    (published,) = [json.loads(line) for line in run.stdout.partition("PROGRAM")[2].splitlines() if line.strip()]
    assert published["source"]["key"] == "robots/9/cloud"
    assert published["concepts"] == [line["answer"]["concepts"] for line in watched][-1]


@pytest.mark.parametrize("told", STREAMS)
def test_streams_that_are_shown_can_be_set(told: str) -> None:
    assert TypeAdapter(tuple[Stream, ...]).validate_python(json.loads(told))


def test_the_key_of_a_ros_topic_is_met_by_the_stream_for_it_and_names_its_format() -> None:
    (key,) = re.findall(r"^0/\S+RIHS01_[0-9a-f]{64}$", PAGE.read_text(), re.MULTILINE)
    assert format_of_key(key) == "pointcloud2"
    shown = [stream["key"] for told in STREAMS for stream in json.loads(told)]
    shown += re.findall(r"`(0/camera\S+/\*)`", PAGE.read_text())
    ros = [expression for expression in shown if "PointCloud2_" in expression]
    assert len(ros) >= 2
    for expression in ros:
        assert zenoh.KeyExpr(expression).intersects(zenoh.KeyExpr(key)), expression
