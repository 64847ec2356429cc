"""gRPC with real processes: the service, its example client, and what the operator does to them."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from grpc_health.v1.health_pb2 import HealthCheckRequest, HealthCheckResponse
from grpc_health.v1.health_pb2_grpc import HealthStub

from service.clouds import write_ply
from service.examples.grpc_client import connect
from service.keys import KeyStore
from service.store import ModelStore
from tests.certificates import Certificate, make_certificate
from tests.learnt import learnt, objects

PATIENCE = 60.0  # seconds that anything may take


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> str:
    store = ModelStore(tmp_path_factory.mktemp("store"))
    store.publish(learnt(), name="tiny", seed=5, source={"simulated": 14})
    return store.url


@contextmanager
def serving(
    store: str, log: Path, tls: Certificate | None = None, **settings: str
) -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    """A process that serves a store, once it is healthy, and where it listens."""
    if tls:
        settings |= {"tls_certificate": str(tls.certificate), "tls_key": str(tls.key)}
    environment = os.environ | {f"SHAPE_CONCEPTS_{name.upper()}": value for name, value in settings.items()}
    command = [sys.executable, "-m", "service.cli", "serve", "--port", "0", "--grpc-port", "0", "--store", store]
    with log.open("wb") as stderr:
        process = subprocess.Popen(command, stderr=stderr, env=environment)
    try:
        found = None
        while found is None:
            assert process.poll() is None
            found = re.search(r"gRPC on (\S+)", log.read_text())
        with connect(found[1], tls and tls.certificate) as channel:
            status = None
            while status != HealthCheckResponse.SERVING:
                status = HealthStub(channel).Check(HealthCheckRequest(), wait_for_ready=True, timeout=PATIENCE).status
        yield process, found[1]
    finally:
        process.kill()
        process.wait()


def client(*arguments: str | Path, key: str = "") -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "service.examples.grpc_client", *map(str, arguments)]
    environment = os.environ | {"ACCESS_KEY": key}
    return subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False, env=environment)


def test_the_example_client_does_what_it_says(store: str, tmp_path: Path) -> None:
    files = [tmp_path / f"{number}.ply" for number in range(6)]
    for file, thing in zip(files, objects(), strict=False):
        file.write_bytes(write_ply(thing.cloud))
    bad = tmp_path / "bad.pcd"
    bad.write_bytes(b"# .PCD v0.7\nVERSION 0.7\n")
    with serving(store, tmp_path / "log") as (process, address):
        answered = r"novelty \d\.\d\d, concepts \d+ \(-?\d+\.\d\), \d+ \(-?\d+\.\d\), \d+ \(-?\d+\.\d\)"
        one = client("--address", address, files[0])
        assert one.returncode == 0, one.stderr
        assert re.fullmatch(rf"{files[0]}: {answered}\n", one.stdout)

        several = client("--address", address, "--model", "tiny:1", *files[:3], bad, *files[3:])
        assert several.returncode == 1
        assert several.stdout.startswith(one.stdout)
        assert re.findall(rf"^(.+): {answered}$", several.stdout, re.MULTILINE) == [*map(str, files)]
        assert re.fullmatch(rf"{bad}: The cloud cannot be read: .+\n", several.stderr)

        unknown = client("--address", address, "--model", "nobody", files[0])
        assert (unknown.returncode, unknown.stderr.startswith("NOT_FOUND: ")) == (1, True)

        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE) == 0
    assert "Traceback" not in (tmp_path / "log").read_text()


def test_a_key_opens_what_TLS_protects(store: str, tmp_path: Path) -> None:
    file = tmp_path / "cloud.ply"
    file.write_bytes(write_ply(objects()[0].cloud))
    tls = make_certificate(tmp_path)
    key = KeyStore(store).create("robot", ("answer",)).text
    with serving(store, tmp_path / "log", tls, access="keys") as (_, address):
        secure = ("--address", address, "--certificate", tls.certificate, file)
        assert client(*secure, key=key).returncode == 0
        assert client(*secure).stderr.startswith("UNAUTHENTICATED: ")
        plain = client("--address", address, file, key=key)
        assert (plain.returncode, plain.stderr.startswith("UNAVAILABLE: ")) == (1, True)


def test_a_taken_port_is_told_and_not_a_success(store: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        command = [sys.executable, "-m", "service.cli", "serve", "--port", "0", "--grpc-port", port, "--store", store]
        ended = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert ended.returncode == 1
    assert f"Port {port} of 127.0.0.1: address already in use" in ended.stderr
    assert "--grpc-port" in ended.stderr
    assert "Traceback" not in ended.stderr
