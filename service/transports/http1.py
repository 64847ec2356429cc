"""HTTP/1.1 on one connection: uvicorn's protocol over llhttp, with limits, answers in order, and fewer writes."""

from __future__ import annotations

import asyncio
from typing import Any

import httptools
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

BESIDE = 65_536  # bytes of a request that are not its body: its line, its headers, and what frames a body in pieces
AHEAD = 64  # requests that may wait for the one before them to be answered
INVALID = "Invalid HTTP request received."


class Invalid(Exception):
    """A request is none; the text says why."""


class Protocol(HttpToolsProtocol):
    """A connection.

    The parser takes heads of any length into memory. Here a request may have `BESIDE` bytes that are not its body, and
    as many again as the body has: a body in pieces of a few bytes each has about as much around them. It also parses
    all that has arrived, while the first request of it is still to be answered: so no more than `AHEAD` may wait, and
    what is no request is told so after the answers to those before it. An offer to speak another protocol is passed
    over, as it may be. Whoever takes longer for a head than a connection may idle is hung up on.
    """

    _beside = 0
    _body = 0
    _in_head = False
    _refusal: str | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override] # as uvicorn has it
        """Called once."""
        super().connection_made(_Joined(transport))  # type: ignore[arg-type] # it has all that uvicorn asks of one
        self._be_patient()

    def on_message_begin(self) -> None:
        """A request begins."""
        self._beside = self._body = 0
        self._in_head = True
        self._unset_keepalive_if_required()
        super().on_message_begin()

    def on_headers_complete(self) -> None:
        """A request's head is there."""
        self._in_head = False
        self._unset_keepalive_if_required()
        if not self.parser.should_upgrade():
            _check(self.parser.get_http_version(), self.headers, len(self.pipeline))
            super().on_headers_complete()

    def on_message_complete(self) -> None:
        """A request is there."""
        if not self.parser.should_upgrade():
            super().on_message_complete()

    def on_body(self, body: bytes) -> None:
        """A piece of a body."""
        self._beside -= len(body)
        self._body += len(body)
        super().on_body(body)

    def data_received(self, data: bytes) -> None:
        """Bytes have arrived."""
        if self._refusal:
            return
        self._beside += len(data)
        try:
            self._parse(data)
        except httptools.HttpParserError as error:
            self._refuse(str(error.__context__) if isinstance(error.__context__, Invalid) else INVALID)
        else:
            if self._beside > BESIDE + self._body:
                self._refuse(f"What is not body of a request may have {BESIDE} bytes.")
            elif self.timeout_keep_alive_task is None and (self._in_head or not self._under_way):
                self._be_patient()

    def on_response_complete(self) -> None:
        """A request is answered."""
        last = not self.pipeline
        super().on_response_complete()
        if last and self._refusal and not self.transport.is_closing():
            self.send_400_response(self._refusal)

    def timeout_keep_alive_handler(self) -> None:
        """Nothing came for long, or no more than a part of a head."""
        if not self._under_way:
            super().timeout_keep_alive_handler()

    @property
    def _under_way(self) -> bool:
        """Whether a request is still to be answered."""
        return self.cycle is not None and not self.cycle.response_complete

    def _be_patient(self) -> None:
        self.timeout_keep_alive_task = self.loop.call_later(self.timeout_keep_alive, self.timeout_keep_alive_handler)

    def _parse(self, data: bytes) -> None:
        """Has the parser call what is called `on_` here; where it stops at an offer to upgrade, it is set going again.

        Raises:
            HttpParserError: it is no request.
        """
        rest = memoryview(data)
        while True:
            try:
                return self.parser.feed_data(rest)
            except httptools.HttpParserUpgrade as upgrade:
                rest = rest[upgrade.args[0] :]
                head = self._head_without_upgrade()
                self.parser = httptools.HttpRequestParser(self)
                self.parser.set_dangerous_leniencies(lenient_data_after_close=True)  # as uvicorn's own
                self.parser.feed_data(head)

    def _head_without_upgrade(self) -> bytes:
        method = self.parser.get_method()
        if method == b"CONNECT":
            raise httptools.HttpParserError("This is no proxy.")
        lines = [b"%b %b HTTP/%b" % (method, self.url, self.parser.get_http_version().encode())]
        lines += [b"%b: %b" % header for header in self.headers if header[0] != b"upgrade"]
        return b"\r\n".join([*lines, b"", b""])

    def _refuse(self, said: str) -> None:
        """Says, once all that came before is answered, why that is the last, and hangs up."""
        self._refusal = said
        self.logger.warning("%s", said)
        if self._under_way and self.cycle.more_body:  # what is wrong is in its body
            if self.pipeline:
                self.pipeline.popleft()
            elif self.cycle.response_started:
                return self.transport.close()
            else:
                return self.send_400_response(said)
        if not self._under_way:
            self.send_400_response(said)


def _check(version: str, headers: list[tuple[bytes, bytes]], ahead: int) -> None:
    """Refuses what the parser lets pass.

    Raises:
        Invalid: a message says why.
    """
    if ahead > AHEAD:
        raise Invalid(f"No more than {AHEAD} requests may be sent ahead of their answers.")
    hosts = 0
    for name, value in headers:
        if name == b"host":
            hosts += 1
        elif name == b"transfer-encoding" and value.lower() != b"chunked":
            raise Invalid("Of the transfer codings none but chunked is known.")
    if hosts != 1 and version == "1.1":
        raise Invalid("A request has one Host header.")


class _Joined:
    """A transport that sends what is written at one time at one go: a head and its body would be two system calls."""

    def __init__(self, transport: asyncio.Transport) -> None:
        self._transport = transport
        self._loop = asyncio.get_running_loop()
        self._written: list[bytes] = []

    def write(self, data: bytes) -> None:
        """Sends bytes as soon as the event loop has its turn."""
        if not self._written:
            self._loop.call_soon(self._send)
        self._written.append(data)

    def close(self) -> None:
        """Sends what was written, and closes."""
        self._send()
        self._transport.close()

    def _send(self) -> None:
        if self._written:
            data, self._written = b"".join(self._written), []
            if not self._transport.is_closing():
                self._transport.write(data)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._transport, name)
