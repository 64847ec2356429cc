"""What the service's tests share: a small model that was truly learnt, stores that hold it, and a running server."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
import uvicorn

from service.application import Application
from service.engine.cloud import PointCloud
from service.engine.model import ShapeModel
from service.engine.params import ModelParams
from service.settings import Settings
from service.store import ModelStore
from service.transports.rest.app import create_app
from worker.learning.train import NamedCloud, train
from worker.simulation import simulate


@pytest.fixture(scope="session")
def clouds() -> list[PointCloud]:
    """Eight simulated objects."""
    return [simulated.cloud for simulated in simulate(8, 7, renderer="raycast")]


@pytest.fixture(scope="session")
def model(clouds: list[PointCloud]) -> ShapeModel:
    """A model learnt from them."""
    return train([NamedCloud(f"{i}.ply", cloud) for i, cloud in enumerate(clouds)], ModelParams()).model


@pytest.fixture
def store(tmp_path: Path, model: ShapeModel) -> ModelStore:
    """A store that holds the model as `tiny:1`."""
    store = ModelStore(tmp_path / "store")
    store.publish(model, name="tiny", seed=7, source={"simulated": 8})
    return store


@pytest.fixture
def settings(store: ModelStore, monkeypatch: pytest.MonkeyPatch) -> Settings:
    """Settings for that store, whatever the environment of the tests says."""
    for name in [name for name in os.environ if name.startswith("SHAPE_CONCEPTS_")]:
        monkeypatch.delenv(name)
    return Settings(store=store.url, workers=2, queue=2, max_body=2**20, body_timeout=5)


@pytest.fixture
def application(settings: Settings) -> Iterator[Application]:
    application = Application(settings)
    yield application
    application.close()


@pytest.fixture
def client(application: Application) -> Iterator[httpx.Client]:
    """A client of a server that answers on the loopback address for the length of a test."""
    config = uvicorn.Config(create_app(application), host="127.0.0.1", port=0, log_level="error")
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run)
    thread.start()
    while not server.started:
        time.sleep(0.01)
    port = server.servers[0].sockets[0].getsockname()[1]
    with httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=30) as client:
        yield client
    server.should_exit = True
    thread.join()
