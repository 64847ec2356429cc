"""HTTP/1.1 on one connection: uvicorn's protocol over llhttp, with a limit on what is not body, and fewer writes."""

from __future__ import annotations

import asyncio
from typing import Any

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

BESIDE = 65_536  # bytes of a request that are not its body: its line, its headers, and what frames a body in pieces


class Protocol(HttpToolsProtocol):
    """A connection.

    The parser takes heads of any length into memory. Here a request may have `BESIDE` bytes that are not its body, and
    as many again as the body has: a body in pieces of a few bytes each has about as much around them.
    """

    _beside = 0
    _body = 0

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override] # as uvicorn has it
        """Called once."""
        super().connection_made(_Joined(transport))  # type: ignore[arg-type] # it has all that uvicorn asks of one

    def on_message_begin(self) -> None:
        """A request begins."""
        self._beside = self._body = 0
        super().on_message_begin()

    def on_body(self, body: bytes) -> None:
        """A piece of a body."""
        self._beside -= len(body)
        self._body += len(body)
        super().on_body(body)

    def data_received(self, data: bytes) -> None:
        """Bytes have arrived."""
        self._beside += len(data)
        super().data_received(data)
        if self._beside > BESIDE + self._body and not self.transport.is_closing():
            self.send_400_response(f"What is not body of a request may have {BESIDE} bytes.")


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
