"""What replicas answer, shown to those who watch it at another one: nobody sees which replica a browser has reached.

A replica at which somebody watches a stream subscribes to `shape-concepts/@v1/shown/STREAM/*`, where each replica
publishes, on a key that ends with its own id, while there is such a subscriber elsewhere, and only then.
"""

from __future__ import annotations

import asyncio
import json
import logging
import threading
import time as clock
from contextlib import suppress
from typing import Any

import numpy as np
import zenoh
from pydantic import BaseModel, Field, ValidationError
from zenoh.handlers import Callback

from service.live import POINTS, Live, Shown, ShownCloud
from service.streams import Stream
from service.transports.zenoh.replicas import name_of

log = logging.getLogger(__name__)

SHOWN = "shape-concepts/@v1/shown"
LARGEST = 4 * 2**20  # bytes of a message: the points, and the answers to the objects of a large scene
LOGGED = 10.0  # seconds between two lines of the log about what cannot be read
LENGTH = 4  # bytes that say how long the header is, little-endian
BYTES = 3 * 4 + 2  # of a point and its part


class _Header(BaseModel):
    """What is said of a cloud before its points."""

    key: str = Field(min_length=1, max_length=1000)
    at: float = Field(ge=0, allow_inf_nan=False)
    document: dict[str, Any]
    problem: bool
    measured: int | None = Field(ge=0)
    points: int = Field(ge=0, le=POINTS)


class Showing:
    """Shows the clouds of one stream, those of this replica and of others.

    Args:
        live: who watches here.
        session: of zenoh, open.
        stream: as all replicas have it, word for word.
        loop: on which zenoh is waited for.
    """

    def __init__(self, live: Live, session: zenoh.Session, stream: Stream, loop: asyncio.AbstractEventLoop) -> None:
        self._live, self._session, self._stream, self._loop = live, session, stream, loop
        self._place = f"{SHOWN}/{name_of(stream)}"
        self._publisher = session.declare_publisher(
            f"{self._place}/{session.zid()}",
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.DATA_LOW,
            allowed_destination=zenoh.Locality.REMOTE,
        )
        self._subscriber: zenoh.Subscriber[None] | None = None
        self._open, self._logged = True, -LOGGED
        self._lock = threading.Lock()
        live.tell(self._watchers_changed)

    @property
    def wanted(self) -> bool:
        """Whether somebody watches the stream, here or elsewhere."""
        return self._live.watched(self._stream) or self._watched_elsewhere

    def show(self, shown: Shown) -> None:
        """Shows a cloud that was answered here. May wait for zenoh."""
        self._live.show(shown)
        if self._watched_elsewhere:
            try:
                self._publisher.put(pack(shown))
            except zenoh.ZError as error:
                log.warning("a cloud of %s could not be shown elsewhere: %s", shown.key, error)

    def close(self) -> None:
        """Shows nothing more."""
        self._live.tell_no_more(self._watchers_changed)
        self._open = False
        self._subscribe()
        self._publisher.undeclare()

    @property
    def _watched_elsewhere(self) -> bool:
        status: Any = self._publisher.matching_status  # no bool, unlike what its types say
        return bool(status.matching)

    def _watchers_changed(self) -> None:
        """Called whenever somebody begins or ends to watch, on whatever thread."""
        with suppress(RuntimeError):  # zenoh's loop has ended
            self._loop.call_soon_threadsafe(self._loop.run_in_executor, None, self._subscribe)

    def _subscribe(self) -> None:
        """Listens to other replicas if somebody watches here, and to none otherwise."""
        with self._lock:
            wanted = self._open and self._live.watched(self._stream)
            if wanted and self._subscriber is None:
                self._subscriber = self._session.declare_subscriber(
                    f"{self._place}/*", Callback(self._arrived, indirect=False), allowed_origin=zenoh.Locality.REMOTE
                )
            elif not wanted and self._subscriber is not None:
                self._subscriber.undeclare()
                self._subscriber = None

    def _arrived(self, sample: zenoh.Sample) -> None:
        try:
            if len(sample.payload) > LARGEST:
                raise ValueError(f"{len(sample.payload)} bytes are more than the {LARGEST} that are taken")
            self._live.show(unpack(self._stream, sample.payload.to_bytes()))
        except ValueError as error:  # of another release, or of somebody who is no replica
            if clock.monotonic() - self._logged > LOGGED:
                self._logged = clock.monotonic()
                log.warning("what %s shows cannot be read: %s", str(sample.key_expr)[:200], str(error)[:200])
        except Exception:
            log.exception("a cloud of another replica could not be shown")


def pack(shown: Shown) -> bytes:
    """A message: the length of the header, the header as JSON, points (float32) and their parts (int16)."""
    cloud = shown.cloud
    header = _Header(
        key=shown.key,
        at=shown.at,
        document=shown.document,
        problem=shown.problem,
        measured=None if cloud is None else cloud.measured,
        points=0 if cloud is None else len(cloud.points),
    )
    said = json.dumps(header.model_dump()).encode()  # as answers are: exact floats
    drawn = b"" if cloud is None else cloud.points.astype("<f4").tobytes() + cloud.parts.astype("<i2").tobytes()
    return len(said).to_bytes(LENGTH, "little") + said + drawn


def unpack(stream: Stream, message: bytes) -> Shown:
    """What a message shows.

    Raises:
        ValueError: it is none.
    """
    end = LENGTH + int.from_bytes(message[:LENGTH], "little")
    try:
        header = _Header.model_validate_json(message[LENGTH:end])
    except ValidationError as error:
        raise ValueError(f"its header says {error.errors(include_input=False)[0]['msg']}") from None
    points, drawn = header.points, message[end:]
    if len(drawn) != points * BYTES or (points and header.measured is None):
        raise ValueError(f"{len(drawn)} bytes follow its header, which speaks of {points} points")
    cloud = None
    if header.measured is not None:
        xyz = np.frombuffer(drawn, "<f4", 3 * points).reshape(-1, 3)
        parts = np.frombuffer(drawn, "<i2", points, 12 * points)
        cloud = ShownCloud(xyz.astype(np.float32), parts.astype(np.int16), header.measured)
    return Shown(stream.key, header.key, header.at, header.document, header.problem, cloud)
