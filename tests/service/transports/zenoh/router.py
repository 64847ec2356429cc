"""A zenoh router in a process of its own: python -m tests.service.transports.zenoh.router ENDPOINT [PATH=VALUE...]."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import zenoh

from tests.conftest import ROOT


def session(mode: str = "client", *, connect: str = "", listen: str = "", **more: object) -> zenoh.Session:
    """A session that finds others by nothing but its endpoints."""
    config = zenoh.Config()
    given = {
        "mode": mode,
        "connect/endpoints": [connect] if connect else [],
        "listen/endpoints": [listen] if listen else [],
    }
    for path, value in (given | {"scouting/multicast/enabled": False} | more).items():
        config.insert_json5(path, json.dumps(value))
    return zenoh.open(config)


def free_endpoint() -> str:
    """An endpoint on the loopback address that nobody listens on."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        return f"tcp/127.0.0.1:{free.getsockname()[1]}"


@contextmanager
def routing(endpoint: str, **more: object) -> Iterator[subprocess.Popen[bytes]]:
    """A router that listens on an endpoint, until the context ends."""
    settings = [f"{path}={json.dumps(value)}" for path, value in more.items()]
    command = [sys.executable, "-m", "tests.service.transports.zenoh.router", endpoint, *settings]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=ROOT) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == b"routing\n"
            yield process
        finally:
            process.kill()


if __name__ == "__main__":
    more = {path: json.loads(value) for path, value in (given.split("=", 1) for given in sys.argv[2:])}
    with session("router", listen=sys.argv[1], **more):
        print("routing", flush=True)
        sys.stdin.read()
