"""Compressed bodies of requests, unpacked as they arrive.

A body of a few kilobytes may unfold to gigabytes. What unfolds is passed on piece by piece, so that whoever reads the
body can stop at its own limit, and is cut off beforehand when it unfolds as no cloud does.
"""

from __future__ import annotations

import asyncio
import zlib
from collections.abc import Callable

from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

PIECE = 2**18  # bytes that are unfolded before others have their turn
RATIO = 250  # a depth image of which hardly a pixel returned unfolds a hundredfold; zeros a thousandfold
TOLERATED = 2**24  # bytes that any body may unfold to: a depth camera's frame, all of it empty
ACCEPTED = "gzip, deflate"


class Decoding:
    """Unpacks the bodies of requests that bear a `Content-Encoding`.

    Whoever reads such a body may get an HTTPException: 415, the encoding is unknown; 400, the body is not of it;
    413, it unfolds out of all proportion.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Lets the app receive the body as it was before it was packed."""
        if scope["type"] == "http":
            codings = Headers(scope=scope).get("content-encoding", "").lower().split(",")
            named = [name for coding in codings if (name := coding.strip()) not in ("", "identity")]
            if named:
                receive = _Decoded(receive, named)
        await self._app(scope, receive, send)


class _Decoded:
    """Receives a body, unpacked, in pieces."""

    def __init__(self, receive: Receive, codings: list[str]) -> None:
        self._receive = receive
        self._codings = codings
        self._unpacker: _Unpacker | None = None
        self._more = True
        self._ended = False

    async def __call__(self) -> Message:
        if self._ended:  # all that may come is that the client hangs up
            return await self._receive()
        if self._unpacker is None:
            if len(self._codings) > 1 or self._codings[0] not in _UNPACKERS:
                given = ", ".join(self._codings)[:60]
                detail = f"The body's encoding is '{given}'; one of {ACCEPTED} is read, or none."
                raise HTTPException(415, detail, {"Accept-Encoding": ACCEPTED})
            self._unpacker = _UNPACKERS[self._codings[0]]()
        while self._more or self._unpacker.waiting:
            if not self._unpacker.waiting:
                message = await self._receive()
                if message["type"] != "http.request":
                    return message
                self._more = message.get("more_body", False)
                self._unpacker.feed(message.get("body", b""), last=not self._more)
            else:
                await asyncio.sleep(0)
            if piece := self._unpacker.piece():
                return {
                    "type": "http.request",
                    "body": piece,
                    "more_body": True,
                }  # whether it ends well is not known yet
        self._unpacker.finish()
        self._ended = True
        return {"type": "http.request", "body": b"", "more_body": False}


class _Unpacker:
    """Unpacks one body, a piece at a time."""

    def __init__(self, begin: Callable[[bytes], zlib._Decompress]) -> None:
        self._begin = begin
        self._stream: zlib._Decompress | None = None
        self._packed = b""
        self._read = 0
        self._made = 0
        self.waiting = False

    def feed(self, packed: bytes, *, last: bool) -> None:
        """Takes what has arrived."""
        self._read += len(packed)
        self._packed += packed
        self.waiting = len(self._packed) > 1 or (last and bool(self._packed))  # two bytes tell which stream it is

    def piece(self) -> bytes:
        """The next bytes, none if more has to arrive first."""
        if not self.waiting:
            return b""
        if self._stream is None:
            self._stream = self._begin(self._packed)
        try:
            piece = self._stream.decompress(self._packed, PIECE)
        except zlib.error:
            raise HTTPException(400, "The body is not what its Content-Encoding says, or was damaged.") from None
        self._packed = self._stream.unconsumed_tail
        if self._stream.eof:  # of a file that was appended to, another one follows
            self._packed, self._stream = self._stream.unused_data, None
        self._made += len(piece)
        self.waiting = bool(self._packed) or len(piece) == PIECE
        if self._made > max(TOLERATED, RATIO * self._read):
            detail = f"The body unfolds to more than {RATIO} times its length; send it in another form."
            raise HTTPException(413, detail)
        return piece

    def finish(self) -> None:
        """Refuses a body that ends in the middle."""
        if self._stream is not None:
            raise HTTPException(400, "The body ends before its compressed data does; it was cut off: send it again.")


def _begin_gzip(_: bytes) -> zlib._Decompress:
    return zlib.decompressobj(16 + zlib.MAX_WBITS)


def _begin_deflate(head: bytes) -> zlib._Decompress:
    """The stream in the zlib format, as RFC 9110 has it, or without its header, as some send it."""
    wrapped = len(head) > 1 and head[0] & 15 == zlib.DEFLATED and (head[0] << 8 | head[1]) % 31 == 0
    return zlib.decompressobj(zlib.MAX_WBITS if wrapped else -zlib.MAX_WBITS)


_UNPACKERS: dict[str, Callable[[], _Unpacker]] = {
    "gzip": lambda: _Unpacker(_begin_gzip),
    "x-gzip": lambda: _Unpacker(_begin_gzip),
    "deflate": lambda: _Unpacker(_begin_deflate),
}
