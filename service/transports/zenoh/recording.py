"""A stream recorded into a dataset: the newest cloud of each key while another one is being added."""

from __future__ import annotations

import io
import queue
import time as clock
from collections.abc import Iterator
from contextlib import ExitStack
from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np
import zenoh

from service import clouds
from service.application import Application
from service.clouds.formats import by_content
from service.dataset_cases import Reading
from service.dataset_records import Verdict, refusal
from service.engine.errors import DatasetNotFound, Overloaded, ShapeConceptsError, StoreUnavailable
from service.streams import Stream
from service.transports.zenoh.answering import KEYS, pose_of
from service.transports.zenoh.encodings import POINT_CLOUD2, format_of, format_of_key
from service.transports.zenoh.newest import Newest
from service.transports.zenoh.problems import check_size

TICK = 0.1  # seconds between two looks at the clock


class Recorded(NamedTuple):
    """What became of a cloud.

    Attributes:
        verdict: on it.
        dropped: clouds of its key that were overtaken since the one before.
    """

    verdict: Verdict
    dropped: int


class _Sent(NamedTuple):
    payload: zenoh.ZBytes
    encoding: zenoh.Encoding
    at_ns: int
    held: ExitStack


class Recorder:
    """Adds the clouds of a stream to a dataset.

    zenoh calls on its own threads: there a cloud is only put in its place, and nothing waits without bound.

    Args:
        application: whose datasets these are.
        name: of the dataset.
        stream: what is recorded, and how its clouds are read.

    Raises:
        DatasetNotFound: there is no such dataset.
        InvalidParameter: the stream cannot be.
    """

    def __init__(self, application: Application, name: str, stream: Stream) -> None:
        application.datasets.store.about(name)
        self._application = application
        self._name = name
        self._stream = stream
        self._pose = pose_of(stream)
        self._newest: Newest[_Sent] = Newest(KEYS, 1, self._discard)
        self._wanted: queue.SimpleQueue[str] = queue.SimpleQueue()
        self.dropped = 0
        """Clouds so far that were overtaken by newer ones, or for which there was no room."""

    def arrived(self, sample: zenoh.Sample) -> None:
        """Takes a sample of the stream in."""
        key = str(sample.key_expr)
        if sample.kind != zenoh.SampleKind.PUT or self._stream.is_answer(key):
            return
        held = ExitStack()
        try:
            size = len(sample.payload)
            check_size(size, self._application.settings.max_body)
            held.enter_context(self._application.intake.opened())(size)
        except (ShapeConceptsError, Overloaded):
            held.close()
            self.dropped += 1
            self._newest.drop(key)
            return
        if self._newest.put(key, _Sent(sample.payload, sample.encoding, clock.time_ns(), held)):
            self._wanted.put(key)

    def record(self, seconds: float | None = None) -> Iterator[Recorded]:
        """Adds clouds as they come, for a time or for ever; key after key has its turn.

        Raises:
            StoreUnavailable, DatasetNotFound: they cannot be added any more.
        """
        end = None if seconds is None else clock.monotonic() + seconds
        try:
            while end is None or clock.monotonic() < end:
                try:
                    key = self._wanted.get(timeout=TICK)
                except queue.Empty:
                    continue
                if (taken := self._newest.take(key)) is not None:
                    self._wanted.put(key)
                    with taken.item.held:
                        yield Recorded(self._add(key, taken.item), taken.dropped)
        finally:
            self._newest.clear()

    def _add(self, key: str, sent: _Sent) -> Verdict:
        """Adds a cloud under its key and the time at which it came, as it came or, where it is no file, as NPY."""
        at = f"{datetime.fromtimestamp(sent.at_ns // 10**9, UTC):%Y%m%dT%H%M%S}.{sent.at_ns % 10**9:09}Z"
        data, stream = sent.payload.to_bytes(), self._stream
        how = Reading(stream.unit, self._pose)
        try:
            format = stream.format or format_of_key(key) or format_of(sent.encoding) or by_content(data) or "xyz"
            if format == POINT_CLOUD2:
                most = self._application.settings.max_points
                cloud = clouds.read(data, format, unit=stream.unit, viewpoint=self._pose, max_points=most)
                data, format, how = _npy(cloud.points), "npy", Reading()
            return self._application.datasets.put(self._name, f"{key}/{at}.{format}", data, how, format=format)
        except (DatasetNotFound, StoreUnavailable):
            raise
        except ShapeConceptsError as error:
            return refusal(f"{key}/{at}", error)

    def _discard(self, sent: _Sent) -> None:
        self.dropped += 1
        sent.held.close()


def _npy(points: np.ndarray) -> bytes:
    """The file of (N, 3) points in the sensor's frame, metres."""
    file = io.BytesIO()
    np.save(file, points, allow_pickle=False)
    return file.getvalue()
