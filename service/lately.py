"""What was read from the store lately, kept in memory: so that a slow store, or none, holds up as few as possible."""

from __future__ import annotations

import logging
import threading
import time as clock
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, NamedTuple, TypeVar, cast

from service.engine.errors import ShapeConceptsError, StoreUnavailable
from service.engine.model import ShapeModel

T = TypeVar("T")

log = logging.getLogger(__name__)

READERS = 4  # threads that ask the store again
MOMENT = 0.1  # seconds in which what is at hand is taken


class Models:
    """Models in memory, those used last: versions never change.

    Args:
        load: reads a version from the store.
        limit: how many are kept.
    """

    def __init__(self, load: Callable[[str, int], ShapeModel], limit: int) -> None:
        self._load = load
        self._limit = limit
        self._models: OrderedDict[tuple[str, int], ShapeModel] = OrderedDict()
        self._loading: dict[tuple[str, int], Future[ShapeModel]] = {}
        self._lock = threading.Lock()

    def get(self, name: str, version: int) -> ShapeModel:
        """A version. It is loaded by the first who asks; others who want it wait, and nobody else does.

        Raises:
            ShapeConceptsError: whatever loading raises.
        """
        key = (name, version)
        with self._lock:
            if key in self._models:
                self._models.move_to_end(key)
                return self._models[key]
            loading = self._loading.get(key)
            first = loading is None
            if loading is None:
                loading = self._loading[key] = Future()
        if first:
            self._fill(key, loading)
        return loading.result()

    def loaded(self) -> list[tuple[str, int]]:
        """Names and versions of the models in memory."""
        with self._lock:
            return list(self._models)

    def _fill(self, key: tuple[str, int], loading: Future[ShapeModel]) -> None:
        try:
            model = self._load(*key)
        except BaseException as error:
            with self._lock:
                del self._loading[key]
            loading.set_exception(error)
            return
        with self._lock:
            del self._loading[key]
            self._models[key] = model
            if len(self._models) > self._limit:
                self._models.popitem(last=False)
        loading.set_result(model)


class _Known(NamedTuple):
    value: Any
    at: float  # when it was read or last relied upon; monotonic, seconds


class _Asked(NamedTuple):
    answer: Future[Any]
    at: float  # monotonic, seconds


class Answers:
    """Answers of the store that may change, such as what an alias means.

    They are believed for a moment, then asked for again; while the store is away or slow, what was known last holds.

    Args:
        believed: for how long an answer is taken to be so still, seconds.
        patience: how long to wait for the store before going on with what was known, seconds.
        now: a clock, seconds.
    """

    def __init__(
        self, believed: float = 1.0, patience: float = 1.0, now: Callable[[], float] = clock.monotonic
    ) -> None:
        self._believed = believed
        self._patience = patience
        self._now = now
        self._known: dict[str, _Known] = {}
        self._asked: dict[str, _Asked] = {}
        self._lock = threading.Lock()
        self._readers = ThreadPoolExecutor(READERS, thread_name_prefix="store")

    def get(self, question: str, read: Callable[[], T]) -> T:
        """The answer to a question.

        Args:
            question: names it.
            read: asks the store; called when the answer is not known, or was known a while ago.

        Raises:
            ShapeConceptsError: whatever `read` raises; not `StoreUnavailable` where an answer is known.
        """
        with self._lock:
            now = self._now()
            known = self._known.get(question)
            if known is not None:
                if now - known.at < self._believed:
                    return cast(T, known.value)
                if question not in self._asked:
                    answer: Future[Any] = self._readers.submit(self._ask, question, read)
                    self._asked[question] = _Asked(answer, now)
                asked = self._asked[question]
        if known is None:
            return self._ask(question, read)
        try:
            return cast(T, asked.answer.result(max(0.0, asked.at + self._patience - now)))
        except (StoreUnavailable, TimeoutError) as error:
            self._rely_on(known, question, str(error) or "the store is slow to answer")
            return cast(T, known.value)

    def at_hand(self, question: str) -> bool:
        """Whether the answer is known, and will be believed for another moment: `get` would give it at once."""
        known = self._known.get(question)
        return known is not None and self._now() - known.at < self._believed - MOMENT

    def forget(self) -> None:
        """Believes nothing any more, not even what is being read."""
        with self._lock:
            self._known = {}

    def close(self) -> None:
        """Waits for what was asked last."""
        self._readers.shutdown()

    def _ask(self, question: str, read: Callable[[], T]) -> T:
        answers = self._known  # unless all is forgotten meanwhile
        try:
            value = read()
            with self._lock:
                answers[question] = _Known(value, self._now())
            return value
        except StoreUnavailable:
            raise
        except ShapeConceptsError:  # there is no such thing any more
            with self._lock:
                answers.pop(question, None)
            raise
        finally:
            with self._lock:
                self._asked.pop(question, None)

    def _rely_on(self, known: _Known, question: str, why: str) -> None:
        """Believes an old answer for another moment, and says so once."""
        with self._lock:
            if self._known.get(question) is not known:
                return
            self._known[question] = known._replace(at=self._now())
        log.warning("going on with what was known of %s: %s", question, why)
