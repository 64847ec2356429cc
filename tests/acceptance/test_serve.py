"""The service as a process: started, asked, told to end; and complete without what only training needs."""

from __future__ import annotations

import json
import os
import signal
import socket
import ssl
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest

from service.engine.params import ModelParams
from service.keys import KeyStore
from service.store import ModelStore
from service.transports.rest.examples import CLOUD_XYZ
from tests.certificates import make_certificate
from worker.learning.train import NamedCloud, train
from worker.simulation import simulate


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A store with a model of eight simulated objects."""
    clouds = [NamedCloud(f"{o.index}.ply", o.cloud) for o in simulate(8, 7, renderer="raycast")]
    store = ModelStore(tmp_path_factory.mktemp("store"))
    store.publish(train(clouds, ModelParams()).model, name="tiny", seed=7, source={"simulated": 8})
    return store.url


@contextmanager
def serving(store: str, **settings: str) -> Iterator[tuple[subprocess.Popen[bytes], httpx.Client]]:
    """A process that serves a store, once it answers."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "service.cli", "serve", "--port", str(port), "--grpc-port", "0", "--store", store]
    environment = os.environ | {f"SHAPE_CONCEPTS_{name.upper()}": value for name, value in settings.items()}
    certificate = settings.get("tls_certificate")
    scheme, verify = ("https", ssl.create_default_context(cafile=certificate)) if certificate else ("http", True)
    with (
        subprocess.Popen(command, stderr=subprocess.PIPE, env=environment) as process,
        httpx.Client(base_url=f"{scheme}://127.0.0.1:{port}", timeout=60, verify=verify) as client,
    ):
        try:
            for _ in range(600):
                try:
                    client.get("/healthz")
                    break
                except httpx.ConnectError:
                    time.sleep(0.1)
            yield process, client
        finally:
            process.kill()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_it_answers_and_ends_cleanly_when_told(store: str, number: signal.Signals) -> None:
    with serving(store) as (process, client):
        assert client.get("/readyz").json()["model"] == "tiny"
        response = client.post("/v1/responses", content=CLOUD_XYZ)
        assert response.status_code == 200
        assert response.json()["concepts"]
        client.close()
        process.send_signal(number)
        assert process.wait(20) == 0
        assert process.stderr is not None
        assert b"Traceback" not in process.stderr.read()


def test_a_model_published_meanwhile_is_served_without_a_restart(store: str, tmp_path: Path) -> None:
    with serving(str(tmp_path / "store")) as (_, client):
        assert client.get("/readyz").status_code == 503
        model, _ = ModelStore(store).load("tiny", 1)
        ModelStore(tmp_path / "store").publish(model, name="late", seed=7, source={})
        assert client.get("/readyz").json()["model"] == "late"


def test_a_taken_port_is_told_and_not_a_success(store: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        command = [sys.executable, "-m", "service.cli", "serve", "--port", port, "--grpc-port", "0", "--store", store]
        ended = subprocess.run(command, capture_output=True, timeout=60, check=False)
    assert ended.returncode == 1
    assert b"address already in use" in ended.stderr
    assert b"Traceback" not in ended.stderr


def test_it_answers_over_tls_and_not_without(store: str, tmp_path: Path) -> None:
    made = make_certificate(tmp_path)
    with serving(store, tls_certificate=str(made.certificate), tls_key=str(made.key)) as (_, client):
        assert client.get("/readyz").json()["model"] == "tiny"
        with pytest.raises(httpx.RemoteProtocolError):
            httpx.get(str(client.base_url).replace("https", "http"))
        with pytest.raises(httpx.ConnectError):  # nobody vouches for the certificate
            httpx.get(str(client.base_url))


def test_it_listens_to_others_only_where_there_are_keys_or_it_is_told_to(store: str) -> None:
    command = [sys.executable, "-m", "service.cli", "serve", "--host", "0.0.0.0", "--port", "0", "--store", store]
    ended = subprocess.run(command, capture_output=True, timeout=60, check=False)
    assert ended.returncode == 1
    assert b"shape-concepts keys create" in ended.stderr
    assert b"Traceback" not in ended.stderr
    with serving(store, access="open", host="0.0.0.0") as (_, client):
        assert client.get("/v1/models").status_code == 200
    text, key = KeyStore(store).create("robot-7", ("answer",))
    with serving(store, host="0.0.0.0") as (_, client):
        assert client.get("/v1/models").status_code == 401
        assert client.get("/v1/models", headers={"Authorization": f"Bearer {text}"}).status_code == 200
    KeyStore(store).revoke(key.id)


WITHOUT = ("worker", "sapien", "open3d", "joblib", "sklearn", "threadpoolctl")


def test_the_service_needs_nothing_of_the_worker(store: str) -> None:
    code = (
        f"import sys\nfor name in {WITHOUT}: sys.modules[name] = None\n"
        "import service.main\nfrom service.cli import main\nmain()"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code, "respond", "--json", "--model", "tiny", "-"],
        input=CLOUD_XYZ.encode(),
        capture_output=True,
        env=os.environ | {"SHAPE_CONCEPTS_STORE": store},
        timeout=120,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr.decode()
    assert json.loads(ended.stdout)["concepts"]
