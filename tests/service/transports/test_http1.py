"""A connection of HTTP/1.1, by real sockets: what is too long is refused, and all else is answered."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator

import pytest
import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from service.transports.http1 import BESIDE, Protocol

PATIENCE = 10.0  # seconds


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    """Of a server that says how many bytes a body has."""

    async def count(request: Request) -> Response:
        return Response(str(len(await request.body())))

    app = Starlette(routes=[Route("/", count, methods=["POST"])])
    server = uvicorn.Server(uvicorn.Config(app, host="127.0.0.1", port=0, log_level="error", http=Protocol))
    thread = threading.Thread(target=server.run)
    thread.start()
    while not server.started:
        time.sleep(0.01)
    yield server.servers[0].sockets[0].getsockname()[1]
    server.should_exit = True
    thread.join()


@pytest.fixture
def client(port: int) -> Iterator[socket.socket]:
    with socket.create_connection(("127.0.0.1", port), PATIENCE) as client:
        yield client


def told(client: socket.socket, body: bytes) -> bytes:
    """The body of the next answer, whose head says how long it is."""
    got = b""
    while not got.endswith(b"\r\n\r\n" + body):
        piece = client.recv(65_536)
        assert piece, got
        got += piece
    assert f"content-length: {len(body)}".encode() in got.lower()
    return got


def asking(body: bytes, *headers: str) -> bytes:
    head = ["POST / HTTP/1.1", "Host: x", f"Content-Length: {len(body)}", *headers]
    return "\r\n".join([*head, "", ""]).encode() + body


def in_pieces(body: bytes, length: int) -> bytes:
    pieces = [body[at : at + length] for at in range(0, len(body), length)]
    framed = b"".join(b"%x\r\n%b\r\n" % (len(piece), piece) for piece in pieces)
    return b"POST / HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n" + framed + b"0\r\n\r\n"


@pytest.mark.parametrize("length", [0, 1, 100_000, 3_000_000])
def test_bodies_of_any_length_are_received_one_after_another(client: socket.socket, length: int) -> None:
    for _ in range(3):
        client.sendall(asking(bytes(length)))
        told(client, str(length).encode())


@pytest.mark.parametrize(("length", "piece"), [(10, 1), (50_000, 8), (300_000, 5000)])
def test_a_body_may_come_in_pieces(client: socket.socket, length: int, piece: int) -> None:
    for _ in range(2):
        client.sendall(in_pieces(bytes(length), piece))
        told(client, str(length).encode())


def test_requests_sent_at_once_are_answered_in_order(client: socket.socket) -> None:
    client.sendall(b"".join(asking(bytes(length)) for length in (3, 20, 100)))
    got = told(client, b"100")
    assert got.index(b"\r\n\r\n3HTTP") < got.index(b"\r\n\r\n20HTTP")


def test_long_heads_are_taken(client: socket.socket) -> None:
    client.sendall(asking(b"12", *(f"X-{number}: {'a' * 1000}" for number in range(50))))
    told(client, b"2")


ENDLESS = {
    "one header": b"POST / HTTP/1.1\r\nHost: x\r\nX-Long: ",
    "the path": b"POST /",
    "headers": b"POST / HTTP/1.1\r\nHost: x\r\n",
    "what follows a body in pieces": in_pieces(b"12", 2)[:-2] + b"X-Long: ",
    "the length of a piece": in_pieces(b"12", 2)[:-5] + b"1;",
}


@pytest.mark.parametrize("what", ENDLESS)
def test_what_never_ends_is_refused(client: socket.socket, what: str) -> None:
    sent = 0
    filling = b"X: a\r\n" * 700 if what == "headers" else b"a" * 4096
    try:
        client.sendall(ENDLESS[what])
        while sent < 100 * BESIDE:
            client.sendall(filling)
            sent += len(filling)
            time.sleep(0.001)
    except (BrokenPipeError, ConnectionResetError):
        pass
    assert sent < 50 * BESIDE  # what the system itself holds on the way counts as well


def test_an_answer_comes_before_the_connection_ends(client: socket.socket) -> None:
    client.sendall(asking(b"12", "Connection: close"))
    told(client, b"2")
    assert client.recv(10) == b""
