"""Streams as people watch them: each answered cloud, thinned for drawing, for as long as somebody looks."""

from __future__ import annotations

import asyncio
import threading
import time as clock
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from service.engine.errors import Overloaded, StreamNotFound, StreamsUnavailable
from service.streams import Stream

POINTS = 20_000  # of a cloud that is shown: as many as a screen can tell apart
WATCHERS = 16  # at a time
KEYS = 32  # robots whose newest cloud waits for one watcher: 9 MB at most


class ShownCloud(NamedTuple):
    """Some of a cloud's points, for drawing; any first few of them are spread over the whole cloud, too.

    Attributes:
        points: (M, 3) float32, metres, in the sensor's frame.
        parts: (M,) int16: the segment of each, or the object in a scene; -1 for none.
        measured: how many points the cloud has.
    """

    points: NDArray[np.float32]
    parts: NDArray[np.int16]
    measured: int


class Shown(NamedTuple):
    """A cloud of a stream that was answered.

    Attributes:
        stream: key expression of the stream.
        key: that the cloud came on.
        at: when it was answered, seconds since 1970.
        document: the answer as it is published, or a problem document.
        problem: whether it is a problem.
        cloud: what was measured; None where it could not be read.
    """

    stream: str
    key: str
    at: float
    document: dict[str, Any]
    problem: bool
    cloud: ShownCloud | None


class Seen(NamedTuple):
    """What a watcher is given.

    Attributes:
        shown: the newest cloud of a key.
        skipped: clouds of this key that were answered since the one before, and that this watcher was too slow for.
    """

    shown: Shown
    skipped: int


class Watcher:
    """Somebody who looks at streams. Of each key, the newest cloud waits; those before it are counted.

    Args:
        stream: key expression of the one looked at; None for all.
        loop: on which it waits.
    """

    def __init__(self, stream: str | None, loop: asyncio.AbstractEventLoop) -> None:
        self.stream = stream
        self._loop, self._news = loop, asyncio.Event()
        self._waiting: OrderedDict[tuple[str, str], Seen] = OrderedDict()
        self._lock = threading.Lock()

    async def take(self, patience: float) -> list[Seen]:
        """The newest of each key, the one that waits longest first; nothing if nothing comes within a time, seconds."""
        with suppress(TimeoutError):
            await asyncio.wait_for(self._news.wait(), patience)
        self._news.clear()
        with self._lock:
            taken = list(self._waiting.values())
            self._waiting.clear()
        return taken

    def put(self, shown: Shown) -> None:
        """Lets a cloud wait in the place of the one of its key. From any thread."""
        place = (shown.stream, shown.key)
        with self._lock:
            before = self._waiting.get(place)
            self._waiting[place] = Seen(shown, 0 if before is None else before.skipped + 1)
            if len(self._waiting) > KEYS:
                self._waiting.popitem(last=False)
        self.wake()

    def wake(self) -> None:
        """Lets `take` return. From any thread."""
        with suppress(RuntimeError):  # its loop has ended
            self._loop.call_soon_threadsafe(self._news.set)


class Live:
    """Brings what is answered to those who watch.

    Args:
        streams: that there are.
    """

    def __init__(self, streams: Sequence[Stream]) -> None:
        self.streams = tuple(streams)
        self.ended = False
        self._answering = 0
        self._watchers: list[Watcher] = []
        self._told: list[Callable[[], None]] = []
        self._lock = threading.Lock()

    @property
    def connected(self) -> bool:
        """Whether clouds of the streams are being answered."""
        return self._answering > 0

    @contextmanager
    def answering(self) -> Iterator[None]:
        """Is held by the transport for as long as it answers the streams."""
        self._answering += 1
        try:
            yield
        finally:
            self._answering -= 1

    def tell(self, listener: Callable[[], None]) -> None:
        """Calls a function whenever somebody begins or ends to watch, on whatever thread that is."""
        with self._lock:
            self._told = [*self._told, listener]
        listener()

    def tell_no_more(self, listener: Callable[[], None]) -> None:
        """Calls it no more."""
        with self._lock:
            self._told = [other for other in self._told if other != listener]

    def watched(self, stream: Stream) -> bool:
        """Whether somebody looks at a stream: only then is there a point in thinning its clouds."""
        return any(watcher.stream in (None, stream.key) for watcher in self._watchers)

    def show(self, shown: Shown) -> None:
        """Shows a cloud to those who look at its stream. From any thread; never waits."""
        with self._lock:
            watchers = [watcher for watcher in self._watchers if watcher.stream in (None, shown.stream)]
        for watcher in watchers:
            watcher.put(shown)

    @contextmanager
    def watching(self, stream: str | None = None) -> Iterator[Watcher]:
        """Somebody who looks at a stream, or at all of them, from the running event loop.

        Raises:
            StreamNotFound: there is no such stream, or none at all.
            StreamsUnavailable: zenoh has not been reached yet.
            Overloaded: too many look already.
        """
        self._check(stream)
        watcher = Watcher(stream, asyncio.get_running_loop())
        with self._lock:
            if len(self._watchers) >= WATCHERS:
                raise Overloaded(f"{WATCHERS} clients watch streams already; try again when one of them has left.")
            self._watchers = [*self._watchers, watcher]
        self._tell()
        try:
            yield watcher
        finally:
            with self._lock:
                self._watchers = [other for other in self._watchers if other is not watcher]
            self._tell()

    def end(self) -> None:
        """Lets all who watch go: the service ends."""
        self.ended = True
        for watcher in self._watchers:
            watcher.wake()

    def _tell(self) -> None:
        for listener in self._told:
            listener()

    def _check(self, stream: str | None) -> None:
        if not self.streams:
            raise StreamNotFound(
                "This service answers no streams: set SHAPE_CONCEPTS_STREAMS, and SHAPE_CONCEPTS_ZENOH_CONNECT to "
                "where zenoh is found."
            )
        if stream is not None and stream not in (known := [each.key for each in self.streams]):
            raise StreamNotFound(f"There is no stream '{stream[:200]}'; there are {', '.join(known)[:1000]}.")
        if not self.connected:
            raise StreamsUnavailable("The service has not reached zenoh yet, and tries on; its log says why.")


def shown(stream: Stream, key: str, document: dict[str, Any], *, problem: bool, cloud: ShownCloud | None) -> Shown:
    """A cloud that was answered just now."""
    return Shown(stream.key, key, clock.time(), document, problem, cloud)
