"""Models that an older version of the software has published: refused with what to do, and no harm to the others."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
import uvicorn
from click.testing import CliRunner, Result

from service.application import Application
from service.cli import main
from service.clouds import write_ply
from service.engine.errors import ModelIncompatible
from service.model_file import FORMAT_VERSION, VARYING, sha256
from service.settings import Settings
from service.store import ModelStore
from service.transports.rest.app import create_app
from tests.conftest import ROOT
from tests.learnt import learnt, objects

OPERATIONS = ROOT / "docs" / "operations.md"
REMEDY = "Use the software that published it, or train the model anew."


@pytest.fixture
def store(tmp_path: Path) -> ModelStore:
    """A store after an upgrade: version 1, which production means, is of the layout before; version 2 of today's."""
    store = ModelStore(tmp_path / "store")
    store.publish(learnt(), name="tiny", seed=5, source={"simulated": 14})
    store.publish(learnt(), name="tiny", seed=5, source={"simulated": 14}, alias=None)
    file = tmp_path / "store/models/tiny/versions/00000001.json"
    file.write_text(json.dumps(aged(json.loads(file.read_text()))))
    return store


def aged(facts: dict[str, Any]) -> dict[str, Any]:
    """A manifest as software of the layout before would have written it."""
    older = facts | {"format_version": FORMAT_VERSION - 1}
    lasting = {name: value for name, value in older.items() if name not in VARYING}
    return older | {"digest": sha256(json.dumps(lasting, sort_keys=True, separators=(",", ":")).encode())}


@contextmanager
def served(store: ModelStore) -> Iterator[httpx.Client]:
    """A client of a server that runs on the store."""
    application = Application(Settings(store=store.url))
    server = uvicorn.Server(uvicorn.Config(create_app(application), host="127.0.0.1", port=0, log_level="error"))
    thread = threading.Thread(target=server.run)
    thread.start()
    while not server.started:
        time.sleep(0.01)
    with httpx.Client(
        base_url=f"http://127.0.0.1:{server.servers[0].sockets[0].getsockname()[1]}", timeout=60
    ) as client:
        yield client
    server.should_exit = True
    thread.join()
    application.close()


@pytest.fixture
def cloud() -> bytes:
    return write_ply(objects()[0].cloud)


def call(store: ModelStore, *arguments: str) -> Result:
    return CliRunner().invoke(main, [*arguments, "--store", store.url])


def test_an_older_model_is_refused_with_what_to_do(store: ModelStore, cloud: bytes, tmp_path: Path) -> None:
    with pytest.raises(ModelIncompatible, match=rf"version {FORMAT_VERSION - 1}; .* reads {FORMAT_VERSION}\. {REMEDY}"):
        store.load("tiny", 1)
    file = tmp_path / "cloud.ply"
    file.write_bytes(cloud)
    refused = call(store, "respond", str(file))
    assert refused.exit_code == 1
    assert REMEDY in refused.output
    assert f"{FORMAT_VERSION - 1}; this software reads {FORMAT_VERSION}. {REMEDY}" in OPERATIONS.read_text()


def test_the_service_says_why_it_is_not_ready_and_is_once_the_alias_moves(store: ModelStore, cloud: bytes) -> None:
    with served(store) as client:
        not_ready = client.get("/readyz")
        assert not_ready.status_code == 503
        assert not_ready.json()["type"].endswith("model-incompatible")
        assert REMEDY in not_ready.json()["detail"]
        assert client.get("/healthz").status_code == 200
        answered = client.post("/v1/responses", params={"model": "tiny:2"}, content=cloud)
        assert answered.json()["version"] == 2

    assert call(store, "models", "promote", "tiny:2").exit_code == 0
    with served(store) as client:
        assert client.get("/readyz").json()["version"] == 2
        assert client.post("/v1/responses", content=cloud).json()["version"] == 2


def test_an_older_model_is_listed_and_the_next_version_is_published_beside_it(store: ModelStore) -> None:
    listed = json.loads(call(store, "models", "list", "--json").output)
    assert listed["models"][0]["versions"] == [1, 2]
    assert store.publish(learnt(), name="tiny", seed=5, source={}).version == 3
    assert store.resolve("tiny") == ("tiny", 3)
    assert store.rollback("tiny") == 1  # it is still there for the software that published it
