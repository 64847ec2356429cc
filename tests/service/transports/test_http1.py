"""A connection of HTTP/1.1, by real sockets: what is too long is refused, and all else is answered."""

from __future__ import annotations

import asyncio
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from service.transports.http1 import AHEAD, BESIDE, Protocol

PATIENCE = 10.0  # seconds


@contextmanager
def serving(idle: int) -> Iterator[int]:
    """The port of a server that says how many bytes a body has; idle connections are closed after so many seconds."""

    async def count(request: Request) -> Response:
        return Response(str(len(await request.body())))

    async def linger(request: Request) -> Response:
        await asyncio.sleep(2.5 * idle)
        return Response(str(len(await request.body())))

    app = Starlette(routes=[Route("/", count, methods=["POST"]), Route("/later", linger, methods=["POST"])])
    config = uvicorn.Config(
        app, host="127.0.0.1", port=0, log_level="error", http=Protocol, timeout_keep_alive=idle, lifespan="off"
    )
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run)
    thread.start()
    while not server.started:
        time.sleep(0.01)
    yield server.servers[0].sockets[0].getsockname()[1]
    server.should_exit = True
    thread.join()


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    with serving(idle=75) as port:
        yield port


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


def all_of(client: socket.socket) -> tuple[list[str], list[str]]:
    """The statuses of all answers until the connection ends, and their bodies."""
    got = b""
    while piece := client.recv(65_536):
        got += piece
    answers = [answer.partition(b"\r\n\r\n") for answer in got.split(b"HTTP/1.1 ")[1:]]
    return [head[:3].decode() for head, _, _ in answers], [body.decode() for _, _, body in answers]


BROKEN_BODY = b"POST / HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\nnonsense\r\n"
NO_REQUESTS = {
    "nonsense": b"NONSENSE\r\n\r\n",
    "a body in broken pieces": BROKEN_BODY,
    "no host": b"POST / HTTP/1.1\r\nContent-Length: 0\r\n\r\n",
    "two hosts": asking(b"", "Host: y"),
    "two lengths": asking(b"", "Content-Length: 3"),
    "a length of pieces": asking(b"0\r\n\r\n", "Transfer-Encoding: chunked"),
    "compressed pieces": asking(b"").replace(b"Content-Length: 0", b"Transfer-Encoding: gzip, chunked"),
    "a tunnel": b"CONNECT x:80 HTTP/1.1\r\nHost: x\r\n\r\n",
}


@pytest.mark.parametrize("what", NO_REQUESTS)
def test_what_is_no_request_is_refused_after_the_answers_to_those_before(client: socket.socket, what: str) -> None:
    client.sendall(asking(b"123") + asking(b"") + NO_REQUESTS[what])
    statuses, bodies = all_of(client)
    assert statuses == ["200", "200", "400"]
    assert bodies[:2] == ["3", "0"]


def test_a_body_that_breaks_off_in_nonsense_is_refused_while_it_is_waited_for(client: socket.socket) -> None:
    client.sendall(BROKEN_BODY[:-10])
    client.sendall(BROKEN_BODY[-10:])
    assert all_of(client)[0] == ["400"]


@pytest.mark.parametrize("offer", ["h2c", "websocket"])
def test_an_offer_of_another_protocol_is_passed_over(client: socket.socket, offer: str) -> None:
    """As curl --http2 and Java's own client make it with their first request."""
    headers = f"Upgrade: {offer}", "Connection: Upgrade, HTTP2-Settings"
    client.sendall(asking(b"12345", *headers) + asking(b"", *headers))
    client.sendall(in_pieces(b"1234567", 2).replace(b"Host: x", "\r\n".join(["Host: x", *headers]).encode()))
    client.sendall(asking(b"123", "Connection: close"))
    assert all_of(client) == (["200"] * 4, ["5", "0", "7", "3"])


def test_many_may_be_sent_ahead_of_their_answers_and_more_are_refused(client: socket.socket) -> None:
    client.sendall(b"".join(asking(bytes(length)) for length in range(AHEAD)))
    told(client, str(AHEAD - 1).encode())
    client.sendall(asking(b"") * 3 * AHEAD)  # in less bytes than are read at a time
    statuses, _ = all_of(client)
    assert statuses[-1] == "400"
    assert len(statuses) < 3 * AHEAD


def test_who_sends_no_head_in_time_is_hung_up_on_and_who_waits_for_an_answer_is_not() -> None:
    beginnings = b"", b"\r\n", b"POST / HTTP/1.1\r\nHost:", asking(b"1") + b"POST /"
    later = asking(b"123").replace(b"POST /", b"POST /later")
    with serving(idle=1) as port:
        clients = [socket.create_connection(("127.0.0.1", port), PATIENCE) for _ in (*beginnings, later)]
        for client, beginning in zip(clients, (*beginnings, later + b"POST /"), strict=True):
            client.sendall(beginning)
        assert [all_of(client)[1] for client in clients] == [[], [], [], ["1"], ["3"]]
        for client in clients:
            client.close()
