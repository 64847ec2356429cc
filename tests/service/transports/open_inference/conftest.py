"""A server of all that is answered over HTTP, for the length of a test, and requests of the protocol."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import httpx
import numpy as np
import pytest
import uvicorn

from service.application import Application
from service.engine.cloud import PointCloud
from service.main import http_app


@contextmanager
def answering(application: Application) -> Iterator[httpx.Client]:
    """A client of a server that answers for an application."""
    server = uvicorn.Server(uvicorn.Config(http_app(application), host="127.0.0.1", port=0, log_level="error"))
    thread = threading.Thread(target=server.run)
    thread.start()
    while not server.started:
        time.sleep(0.01)
    port = server.servers[0].sockets[0].getsockname()[1]
    with httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=30) as client:
        yield client
    server.should_exit = True
    thread.join()


@pytest.fixture
def client(application: Application) -> Iterator[httpx.Client]:
    with answering(application) as client:
        yield client


@pytest.fixture
def cloud(clouds: list[PointCloud]) -> np.ndarray:
    """One of the simulated objects (N, 3), thinned out."""
    return clouds[2].points[::8]


def request_of(cloud: np.ndarray, **more: Any) -> dict[str, Any]:
    """The JSON of a request; `more` of its members, or other members of its input."""
    own = {name: more.pop(name) for name in ("name", "datatype", "shape", "data") if name in more}
    sent = {"name": "cloud", "datatype": "FP32", "shape": list(cloud.shape), "data": cloud.ravel().tolist()} | own
    return {"inputs": [sent], **more}
