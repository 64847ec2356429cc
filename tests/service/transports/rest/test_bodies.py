"""A body is never received beyond the limit, nor waited for without end."""

from __future__ import annotations

import logging
import select
import socket
import time
from contextlib import ExitStack

import httpx
import pytest

from service.application import Application
from service.settings import Settings
from tests.service.transports.zenoh.waiting import until

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
            began = time.monotonic()
            wire.sendall(HEAD % (b"application/octet-stream", b"Content-Length: 100") + b"1 2 3")
            assert b"408" in wire.recv(65536).partition(b"\r\n")[0]
            assert 0.2 < time.monotonic() - began < 5
        assert client.post("/v1/responses", content=b"").status_code == 422


class TestWithoutPatienceForPauses:
    @pytest.fixture
    def settings(self, settings: Settings) -> Settings:
        return settings.model_copy(update={"body_pause": 1.5})

    def test_a_body_may_come_slowly_but_not_stand_still(self, client: httpx.Client) -> None:
        with connect(client) as wire:
            wire.sendall(HEAD % (b"application/octet-stream", b"Content-Length: 100"))
            for _ in range(4):  # longer than a pause altogether
                time.sleep(0.4)
                wire.sendall(b"1 2 3\n")
                assert not select.select([wire], [], [], 0)[0]
            assert b"408" in wire.recv(65536).partition(b"\r\n")[0]


class TestWithFewPlaces:
    @pytest.fixture
    def settings(self, settings: Settings) -> Settings:
        return settings.model_copy(update={"workers": 1, "queue": 0, "max_body": 2**16, "max_bodies": 2**17})

    def test_bodies_that_stand_half_sent_keep_nobody_from_an_answer(self, client: httpx.Client) -> None:
        with ExitStack() as stack:
            for _ in range(20):
                wire = stack.enter_context(connect(client))
                wire.sendall(HEAD % (b"application/octet-stream", b"Content-Length: 65000") + b"1 2 3\n")
            for _ in range(3):
                assert client.post("/v1/responses", content=b"1 2 3\n").json()["type"].endswith("too-few-points")

    def test_no_more_bytes_are_held_than_the_limit_says(self, client: httpx.Client, application: Application) -> None:
        with ExitStack() as stack:
            wires = [stack.enter_context(connect(client)) for _ in range(3)]
            for wire in wires:
                wire.sendall(HEAD % (b"application/octet-stream", b"Content-Length: 65536") + b" " * 60_000)
            refused_one = select.select(wires, [], [], 5)[0][0]  # whichever is the third to be read
            assert b"429" in refused_one.recv(65536).partition(b"\r\n")[0]
            refused = client.post("/v1/responses", content=b"1 2 3\n" * 10_000)
            assert (refused.status_code, refused.json()["type"]) == (429, "urn:shape-concepts:error:overloaded")
            assert client.post("/v1/responses", content=b"1 2 3\n").status_code == 422
        until(lambda: application.intake.held == 0, "what was half sent is let go")
        assert client.post("/v1/responses", content=b"1 2 3\n" * 10_000).json()["status"] == 422


@pytest.mark.parametrize("media_type", [b"application/octet-stream", b"multipart/form-data; boundary=x"])
def test_a_client_who_hangs_up_is_no_fault_of_ours(
    client: httpx.Client, caplog: pytest.LogCaptureFixture, media_type: bytes
) -> None:
    with caplog.at_level(logging.INFO):
        with connect(client) as wire:
            wire.sendall(HEAD % (media_type, b"Content-Length: 100") + b"--x\r\n")
            time.sleep(0.1)
        began = time.monotonic()
        while "hung up" not in caplog.text and time.monotonic() - began < 5:
            time.sleep(0.01)
    (said,) = [record for record in caplog.records if "hung up" in record.message]
    assert said.levelno == logging.INFO
    assert max(record.levelno for record in caplog.records) == logging.INFO
    assert "Traceback" not in caplog.text
