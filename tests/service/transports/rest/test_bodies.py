"""A body is never received beyond the limit, nor waited for without end."""

from __future__ import annotations

import select
import socket
import time

import httpx
import pytest

from service.application import Application
from service.settings import Settings

HEAD = b"POST /v1/responses HTTP/1.1\r\nHost: x\r\nContent-Type: %s\r\n%s\r\n\r\n"


def connect(client: httpx.Client) -> socket.socket:
    return socket.create_connection((client.base_url.host, client.base_url.port or 80), timeout=10)


@pytest.mark.parametrize("media_type", [b"application/octet-stream", b"multipart/form-data; boundary=x"])
def test_a_body_without_announced_length_is_cut_off_at_the_limit(
    client: httpx.Client, application: Application, media_type: bytes
) -> None:
    part = b'--x\r\nContent-Disposition: form-data; name="cloud"; filename="a"\r\n\r\n'
    chunk = bytes(2**16)
    sent = 0
    with connect(client) as wire:
        wire.sendall(HEAD % (media_type, b"Transfer-Encoding: chunked"))
        if b"multipart" in media_type:
            wire.sendall(b"%x\r\n%s\r\n" % (len(part), part))
        while not select.select([wire], [], [], 0)[0] and sent < 2**28:
            try:
                wire.sendall(b"%x\r\n%s\r\n" % (len(chunk), chunk))
            except OSError:
                break
            sent += len(chunk)
        assert b"413" in wire.recv(65536).partition(b"\r\n")[0]
    assert sent < application.settings.max_body + 2**25  # what the sockets' buffers may hold


def test_an_announced_length_beyond_the_limit_is_refused_before_a_byte_arrives(client: httpx.Client) -> None:
    with connect(client) as wire:
        wire.sendall(HEAD % (b"application/octet-stream", b"Content-Length: 1000000000000"))
        assert b"413" in wire.recv(65536).partition(b"\r\n")[0]


class TestWithLittlePatience:
    @pytest.fixture
    def settings(self, settings: Settings) -> Settings:
        return settings.model_copy(update={"body_timeout": 0.3, "workers": 1, "queue": 0})

    def test_a_body_that_does_not_come_gives_its_place_to_others(self, client: httpx.Client) -> None:
        with connect(client) as wire:
            wire.sendall(HEAD % (b"application/octet-stream", b"Content-Length: 100") + b"1 2 3")
            began = time.monotonic()
            assert b"408" in wire.recv(65536).partition(b"\r\n")[0]
            assert 0.2 < time.monotonic() - began < 5
        assert client.post("/v1/responses", content=b"").status_code == 422

    def test_a_client_who_leaves_gives_its_place_to_others(self, client: httpx.Client) -> None:
        with connect(client) as wire:
            wire.sendall(HEAD % (b"application/octet-stream", b"Content-Length: 100") + b"1 2 3")
        time.sleep(0.2)
        assert client.post("/v1/responses", content=b"").status_code == 422
