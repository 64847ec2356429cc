"""The newest cloud of each key, while those before it are at work: newest wins, and what is dropped is counted."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

T = TypeVar("T")


class Taken(NamedTuple, Generic[T]):
    """A cloud to work on.

    Attributes:
        item: the cloud.
        dropped: clouds of its key dropped since the last one was taken.
    """

    item: T
    dropped: int


class _Slot(Generic[T]):
    def __init__(self) -> None:
        self.waiting: list[T] = []  # one or none
        self.dropped = 0
        self.workers = 0


class Newest(Generic[T]):
    """At most one waiting cloud a key. Safe to use from any thread.

    A worker is one who takes clouds of a key until there are no more; `put` says when another is wanted.

    Args:
        keys: how many are remembered; those idle longest are forgotten first.
        workers: how many may work on one key at the same time; with one, clouds stay in order.
        discard: is given every cloud that is dropped.
    """

    def __init__(self, keys: int, workers: int, discard: Callable[[T], None]) -> None:
        self._limit = keys
        self._workers = workers
        self._discard = discard
        self._slots: OrderedDict[str, _Slot[T]] = OrderedDict()
        self._lock = threading.Lock()

    def put(self, key: str, item: T) -> bool:
        """Puts the newest cloud of a key in the place of the one that waits.

        Returns:
            Whether a worker is wanted. It has to come, and to `take` until there is nothing.
        """
        with self._lock:
            slot = self._slot(key)
            if slot is None:
                old, wanted = [item], False
            else:
                old, slot.waiting = slot.waiting, [item]
                slot.dropped += len(old)
                wanted = not old and slot.workers < self._workers
                slot.workers += wanted
        for dropped in old:
            self._discard(dropped)
        return wanted

    def drop(self, key: str) -> None:
        """Counts a cloud of a key that was dropped without being put."""
        with self._lock:
            if slot := self._slot(key):
                slot.dropped += 1

    def take(self, key: str) -> Taken[T] | None:
        """The newest cloud of a key; None when there is none, and the worker is to go."""
        with self._lock:
            slot = self._slots[key]  # it has a worker, and is remembered
            if not slot.waiting:
                slot.workers -= 1
                return None
            taken = Taken(slot.waiting.pop(), slot.dropped)
            slot.dropped = 0
            return taken

    def clear(self) -> None:
        """Drops what waits."""
        with self._lock:
            old = [item for slot in self._slots.values() for item in slot.waiting]
            for slot in self._slots.values():
                slot.waiting = []
        for item in old:
            self._discard(item)

    def _slot(self, key: str) -> _Slot[T] | None:
        """The slot of a key, made if need be; None when all that are remembered are at work."""
        if key in self._slots:
            self._slots.move_to_end(key)
        else:
            if len(self._slots) >= self._limit:
                idle = next((name for name, slot in self._slots.items() if not slot.workers), None)
                if idle is None:
                    return None
                del self._slots[idle]
            self._slots[key] = _Slot()
        return self._slots[key]
