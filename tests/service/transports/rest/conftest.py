"""What the tests of the HTTP interface share: a server that asks for access keys."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import httpx
import pytest
import uvicorn

from service.application import Application
from service.settings import Settings
from service.transports.rest.app import create_app


@pytest.fixture
def guarded(settings: Settings) -> Iterator[httpx.Client]:
    """A client, without a key, of a server that asks for keys."""
    application = Application(settings.model_copy(update={"access": "keys"}))
    server = uvicorn.Server(uvicorn.Config(create_app(application), host="127.0.0.1", port=0, log_level="error"))
    thread = threading.Thread(target=server.run)
    thread.start()
    while not server.started:
        time.sleep(0.01)
    with httpx.Client(base_url=f"http://127.0.0.1:{server.servers[0].sockets[0].getsockname()[1]}") as client:
        yield client
    server.should_exit = True
    thread.join()
    application.close()
