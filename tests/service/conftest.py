"""What the service's tests share: a small model that was truly learnt, stores that hold it, and a running server."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
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

S3 = {"AWS_ACCESS_KEY_ID": "tests", "AWS_SECRET_ACCESS_KEY": "tests", "AWS_REGION": "us-east-1"}


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
    url = f"sqlite:///{Path(store.url).parent / 'jobs.sqlite'}"
    return Settings(store=store.url, jobs_url=url, workers=2, queue=2, max_body=2**20, body_timeout=5)


@pytest.fixture
def application(settings: Settings) -> Iterator[Application]:
    application = Application(settings)
    yield application
    application.close()


@contextmanager
def asked_over_http(application: Application) -> Iterator[httpx.Client]:
    """A client of a server that answers for an application on the loopback address, until the context ends."""
    config = uvicorn.Config(create_app(application), host="127.0.0.1", port=0, log_level="error")
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run)
    thread.start()
    while not server.started:
        time.sleep(0.01)
    port = server.servers[0].sockets[0].getsockname()[1]
    try:
        with httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=30) as client:
            yield client
    finally:
        server.should_exit = True
        thread.join()


@pytest.fixture
def client(application: Application) -> Iterator[httpx.Client]:
    """A client of a server that answers on the loopback address for the length of a test."""
    with asked_over_http(application) as client:
        yield client


@pytest.fixture(scope="session")
def bucket() -> Iterator[str]:
    """The endpoint of an S3 server with a bucket `models`."""
    server = pytest.importorskip("moto.server", reason="moto is not installed").ThreadedMotoServer("127.0.0.1", 0)
    server.start()
    endpoint = "http://{}:{}".format(*server.get_host_and_port())
    import boto3

    boto3.client(
        "s3",
        endpoint_url=endpoint,
        region_name="us-east-1",
        aws_access_key_id="tests",
        aws_secret_access_key="tests",
    ).create_bucket(Bucket="models")
    yield endpoint
    server.stop()


@pytest.fixture(params=["folder", "bucket"])
def url(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Where a store may be: a folder, and a bucket."""
    if request.param == "folder":
        return str(tmp_path / "store")
    for name, value in (S3 | {"AWS_ENDPOINT_URL": request.getfixturevalue("bucket")}).items():
        monkeypatch.setenv(name, value)
    return f"s3://models/{tmp_path.name}"
