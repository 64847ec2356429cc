"""Triton's own client, in an environment of its own, is answered as a client of the REST interface is."""

from __future__ import annotations

import inspect
import json
import os
import re
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import httpx
import numpy as np
import pytest

from service.store import ModelStore
from service.transports.open_inference.generated.inference import grpc_service_pb2
from tests.conftest import ROOT
from tests.learnt import learnt, objects

pytestmark = pytest.mark.slow
CLIENT = "tritonclient[http,grpc]==2.73.0"
SERVED = ("responses", "distances", "concept_ids", "concept_times", "ranking", "novelty")
DTYPES = ("float64", "float64", "int64", "float64", "int64", "float64")


class Service(NamedTuple):
    """A service that runs: its addresses, its store, the file of a cloud."""

    http: str
    grpc: str
    store: str
    file: Path

    def answer(self, factor: float = 1.0, **query: Any) -> dict[str, Any]:
        """What REST answers about the cloud."""
        scaled = self.file.with_suffix(".scaled.npy")
        np.save(scaled, np.load(self.file) * np.float32(factor))
        answered = httpx.post(f"http://{self.http}/v1/responses", params=query, content=scaled.read_bytes(), timeout=60)
        assert answered.status_code == 200, answered.text
        found: dict[str, Any] = answered.json()
        return found


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The interpreter of an environment with Triton's client."""
    folder = tmp_path_factory.mktemp("triton")
    subprocess.run([sys.executable, "-m", "venv", folder], check=True)
    python = str(folder / "bin" / "python")
    install = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", CLIENT]
    installed = subprocess.run(install, capture_output=True, text=True, check=False)
    if installed.returncode:
        pytest.skip(f"Triton's client cannot be installed here: {installed.stderr[-300:]}")
    return python


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    folder = tmp_path_factory.mktemp("service")
    store = ModelStore(folder / "store")
    store.publish(learnt(), name="tiny", seed=5, source={"simulated": 14})
    np.save(folder / "cloud.npy", objects()[3].cloud.points)
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "service.cli", "serve", "--port", str(port), "--grpc-port", "0"]
    log = folder / "log"
    with log.open("wb") as stderr:
        process = subprocess.Popen([*command, "--store", store.url], stderr=stderr)
    try:
        until = time.monotonic() + 60
        while not ((grpc := re.search(r"gRPC on (\S+)", log.read_text())) and is_ready(port)):
            assert process.poll() is None
            assert time.monotonic() < until, log.read_text()
            time.sleep(0.1)
        yield Service(f"127.0.0.1:{port}", grpc[1], store.url, folder / "cloud.npy")
        assert "Traceback" not in log.read_text()
    finally:
        process.kill()
        process.wait()


def is_ready(port: int) -> bool:
    try:
        return httpx.get(f"http://127.0.0.1:{port}/v2/health/ready").status_code == 200
    except httpx.ConnectError:
        return False


def fields_of(file: Any) -> dict[str, list[Any]]:
    """The fields of a file's messages by their full names, and its calls: what is on the wire."""
    found: dict[str, list[Any]] = {}

    def add(message: Any) -> None:
        for field in message.fields:
            found[field.full_name] = [field.number, field.type, field.message_type and field.message_type.full_name]
            found[field.full_name].append(field.containing_oneof and field.containing_oneof.name)
        for inner in message.nested_types:
            add(inner)

    for message in file.message_types_by_name.values():
        add(message)
    for service in file.services_by_name.values():
        for call in service.methods:
            found[call.full_name] = [call.input_type.full_name, call.output_type.full_name]
    return found


def run(*command: str | Path, **more: str) -> subprocess.CompletedProcess[str]:
    alone = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False, env=alone | more)


def check_plain(told: dict[str, Any], expected: dict[str, Any]) -> None:
    """An answer without wishes has the numbers of REST, to the last bit."""
    assert (told["model"], told["version"]) == ("tiny", "1")
    assert told["dtypes"] == dict(zip(SERVED, DTYPES, strict=True))
    values = told["values"]
    assert values["responses"] == expected["responses"]
    assert values["distances"] == expected["distances"]
    assert values["novelty"] == [expected["novelty"]]
    concepts = expected["concepts"]
    assert [values["concept_ids"][place] for place in values["ranking"]] == [each["id"] for each in concepts]
    assert [values["concept_times"][place] for place in values["ranking"]] == [each["time"] for each in concepts]


def test_the_fields_of_the_messages_are_those_of_tritons_client(python: str) -> None:
    code = "import json\nfrom typing import Any\nfrom tritonclient.grpc import service_pb2\n"
    done = run(
        python, "-c", f"{code}{inspect.getsource(fields_of)}\nprint(json.dumps(fields_of(service_pb2.DESCRIPTOR)))"
    )
    assert done.returncode == 0, done.stderr
    theirs, ours = json.loads(done.stdout), fields_of(grpc_service_pb2.DESCRIPTOR)
    assert len(ours) > 60
    assert {name: theirs.get(name) for name in ours} == ours


def test_every_call_is_answered_as_over_rest(python: str, service: Service) -> None:
    done = run(python, ROOT / "tests" / "acceptance" / "triton_calls.py", service.http, service.grpc, service.file)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    plain = service.answer(stimuli=True)
    other = service.answer(1000, time=0.3, top=2, unit="mm", viewpoint="0,0,-100")
    for told in found["packed"]:
        check_plain(told, plain)
    for wire in ("http", "grpc"):
        said = found[wire]
        assert [said[name] for name in ("live", "ready", "model_ready", "version_ready")] == [True] * 4
        assert said["other_ready"] is False
        assert "binary_tensor_data" in said["server"]["extensions"]
        assert said["model"]["versions"] == ["1"]
        (tensor,) = said["model"]["inputs"]
        assert (tensor["name"], tensor["datatype"], [int(n) for n in tensor["shape"]]) == ("cloud", "FP32", [-1, 3])
        for told in said["plain"]:
            check_plain(told, plain)
            assert told["id"] == "7"
        check_plain(said["scheduled"], plain)
        for told in said["wanted"]:
            values = told["values"]
            assert values["responses"] == plain["responses"]
            assert values["stimuli_index"] == plain["stimuli"]["index"]
            assert values["stimuli_value"] == plain["stimuli"]["value"]
            assert values["truncated"] == [plain["truncated"]]
            assert values["warnings"] == plain["warnings"]
            assert told["dtypes"]["stimuli_value"] == "float32"
        assert said["parameters"]["values"]["responses"] == other["responses"]
        assert len(said["parameters"]["values"]["ranking"]) == 2
        for told in found[f"{wire}_at_once"]:
            check_plain(told, plain)
        statuses = [said[name]["status"] for name in ("no_model", "no_points", "no_metadata")]
        codes = {"http": ["404", "422", "404"], "grpc": ["NOT_FOUND", "INVALID_ARGUMENT", "NOT_FOUND"]}
        assert [status.removeprefix("StatusCode.") for status in statuses] == codes[wire]
        assert "tiny" in said["no_model"]["message"]
        assert "NaN" in said["no_points"]["message"] or "measure" in said["no_points"]["message"]
    assert (len(found["http"]["plain"]), len(found["http"]["wanted"])) == (2, 4)


def test_the_example_does_what_it_says(python: str, service: Service, tmp_path: Path) -> None:
    example = ROOT / "service" / "examples" / "open_inference_client.py"
    text = tmp_path / "cloud.xyz"
    np.savetxt(text, np.load(service.file))
    best = service.answer()["concepts"][0]["id"]
    for address, file, more in ((service.http, service.file, []), (service.grpc, text, ["--grpc"])):
        done = run(python, example, "--address", address, "--model", "tiny", *more, file)
        assert done.returncode == 0, done.stderr
        told = re.fullmatch(
            rf"{file}: tiny:1, novelty \d\.\d\d, concepts (\d+) \(-?\d+\.\d\)(, .*){{2}}\n", done.stdout
        )
        assert told, done.stdout
        assert int(told[1]) == best
        refused = run(python, example, "--address", address, "--model", "none", *more, file)
        assert (refused.returncode, refused.stdout) == (1, "")
        assert "tiny" in refused.stderr
        assert "Traceback" not in refused.stderr
