"""The page for operators: keys, TLS and metrics, in a real shell; and which metrics there are."""

from __future__ import annotations

import json
import os
import re
import socket
from pathlib import Path

import pytest

from service.clouds import write_ply
from service.metrics import PREFIX, Metrics, State
from tests.conftest import ROOT
from tests.docs.test_tutorial import blocks, commands_in, needs_curl, shell
from tests.learnt import named_clouds

PAGE = ROOT / "docs" / "operations.md"


def below(heading: str) -> str:
    """What stands below a heading of the page."""
    return PAGE.read_text().partition(f"## {heading}\n")[2].partition("\n## ")[0]


def test_all_that_operators_ask_for_has_its_heading() -> None:
    headings = re.findall(r"^## (.*)$", PAGE.read_text(), re.MULTILINE)
    assert {"Making it larger", "Keys", "TLS", "Metrics, logs and traces", "Backup", "Restore"} <= set(headings)


def test_every_metric_is_told_and_no_other() -> None:
    metrics = Metrics()
    state = State(at_work=0, waiting=0, places=1, held=0, limit=1, loaded=[("a", 1)], serving={("a", "production"): 1})
    metrics.watch(lambda: state)
    kinds = dict(re.findall(rf"^# TYPE {PREFIX}_(\w+) (\w+)$", metrics.page()[0].decode(), re.MULTILINE))
    there = {name for name in kinds if not name.endswith("_created")}
    rows = [line.split("|")[1] for line in below("Metrics, logs and traces").splitlines() if line.startswith("| `")]
    told = {name.partition("{")[0] for row in rows for name in re.findall(r"`([^`]+)`", row)}
    assert told == there


@needs_curl
@pytest.mark.slow
def test_keys_tls_and_metrics_are_tried_as_the_page_says(tmp_path: Path) -> None:
    (tmp_path / "mug.ply").write_bytes(write_ply(named_clouds()[0].cloud))
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    commands = [
        block
        for block in blocks(PAGE)
        for heading in ("Keys", "TLS", "Metrics, logs and traces")
        if block in below(heading)
    ]
    assert len(commands) == 3
    script = "\necho\n".join(commands).replace("localhost:8000", f"localhost:{port}")
    environment = {name: value for name, value in os.environ.items() if not name.startswith("SHAPE_CONCEPTS_")} | {
        "PATH": f"{commands_in(tmp_path)}:{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "SHAPE_CONCEPTS_PORT": str(port),
        "SHAPE_CONCEPTS_GRPC_PORT": "-1",
        "SHAPE_CONCEPTS_STORE": str(tmp_path / "store"),
    }
    stranger = f"curl --silent --cacert certificate.pem https://localhost:{port}/metrics"
    run = shell(f"{script}\n{stranger}\nkill $!\nwait", tmp_path, environment)
    assert run.returncode == 0, run.stdout + run.stderr
    answer = next(json.loads(line) for line in run.stdout.splitlines() if line.startswith('{"model"'))
    assert len(answer["concepts"]) == 1
    assert f'{PREFIX}_requests_total{{operation="POST /v1/responses",outcome="ok",wire="rest"}} 1.0' in run.stdout
    assert "revoked" in run.stdout
    assert "not-authenticated" in run.stdout.splitlines()[-1]
