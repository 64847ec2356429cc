"""How the service is seen from outside: the one place where every transport's requests are measured.

A transport enters `request` for each request, and the rest follows: metrics, the line in the log, the span.

    with telemetry.request("rest", request_id) as seen:
        ...
        seen.failed(error)  # where an error is told to the client instead of being raised

What works for the request meanwhile, on whatever thread of the pool, finds it by `current()`.
"""

from __future__ import annotations

import asyncio
import logging
import time as clock
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any, Literal

from service.answer import Answer
from service.engine.errors import ShapeConceptsError
from service.engine.model import OnStage
from service.metrics import Metrics
from service.traces import Stage, Traces

if TYPE_CHECKING:
    from opentelemetry.trace import Span

Wire = Literal["rest", "open-inference", "grpc", "zenoh"]
LOCAL = "local"  # the wire of answers that no transport asked for: the command line's, and the first that warms up
OTHER = "other"  # the operation of requests for what is not there

log = logging.getLogger(__name__)


class Seen:
    """A request under way.

    Attributes:
        wire: that it came by.
        request_id: its name in logs and answers.
        operation: what it asks for: a route's template or a method's name, never as the client wrote it.
        caller: id of the access key, None while it is not known.
        model: name and version that answered, None while there is no answer.
        outcome: "ok", or the name of the error.
    """

    def __init__(self, wire: Wire, request_id: str, operation: str, span: Span | None) -> None:
        self.wire = wire
        self.request_id = request_id
        self.operation = operation
        self.caller: str | None = None
        self.model: tuple[str, int] | None = None
        self.outcome = "ok"
        self.trace_id: str | None = None
        self.span = span

    def failed(self, error: BaseException | str) -> None:
        """Notes why the request fails; the first reason stays.

        Args:
            error: the error, or the stable name of one that only this transport has; never a client's text.
        """
        if self.outcome == "ok":
            self.outcome = error if isinstance(error, str) else _name(error)

    def facts(self) -> dict[str, Any]:
        """What is known of the request, for the log and the span."""
        known = {
            "request_id": self.request_id,
            "wire": self.wire,
            "operation": self.operation,
            "outcome": self.outcome,
            "caller": self.caller,
            "model": None if self.model is None else "{}:{}".format(*self.model),
            "trace_id": self.trace_id,
        }
        return {name: value for name, value in known.items() if value is not None}


_current: ContextVar[Seen | None] = ContextVar("seen", default=None)


def current() -> Seen | None:
    """The request that is being worked for, if there is one."""
    return _current.get()


class Telemetry:
    """Measures requests and answers.

    Args:
        traces: makes spans of them; None for none.
    """

    def __init__(self, traces: Traces | None = None) -> None:
        self.metrics = Metrics()
        self._traces = traces

    @contextmanager
    def request(
        self, wire: Wire, request_id: str, operation: str = OTHER, carrier: Mapping[str, str] | None = None
    ) -> Iterator[Seen]:
        """A request, from its arrival to its end. An error that is raised is its outcome.

        Args:
            wire: that it came by.
            request_id: its name in logs and answers.
            operation: what it asks for; may be set later, as `Seen.operation`.
            carrier: what may have the client's W3C `traceparent` and `tracestate`, under these names.
        """
        span = None if self._traces is None else self._traces.begin(wire, carrier or {})
        seen = Seen(wire, request_id, operation, span)
        if self._traces is not None and span is not None:
            seen.trace_id = self._traces.trace_id(span)
        outer, began = _current.get(), clock.perf_counter()
        _current.set(seen)
        self.metrics.under_way.add(1, wire)
        try:
            yield seen
        except BaseException as error:
            seen.failed(error)
            raise
        finally:
            # not by a token: a generator may be closed in another context than it was begun in
            _current.set(outer)
            self._end(seen, clock.perf_counter() - began)

    @contextmanager
    def answering(self, on_stage: OnStage) -> Iterator[Stages]:
        """The stages of an answer, for whichever request is being worked for.

        Args:
            on_stage: is told of each stage as it begins; may raise `Cancelled`.
        """
        stages = Stages(on_stage)
        failed = True
        try:
            yield stages
            failed = False
        finally:
            stages.end()
            self._tell(stages, failed)

    def answered(self, answer: Answer) -> None:
        """Counts an answer."""
        self.metrics.novelty.observe(answer.novelty)
        if (seen := current()) is not None:
            seen.model = (answer.model, answer.version)

    def dropped(self, wire: Wire, count: int = 1) -> None:
        """Counts clouds of streams that were not answered, as newer ones had come."""
        self.metrics.drops.add(count, wire)

    def close(self) -> None:
        """Sends what was not sent yet."""
        if self._traces is not None:
            self._traces.close()

    def _tell(self, stages: Stages, failed: bool) -> None:
        seen = current()
        if not failed:
            wire = LOCAL if seen is None else seen.wire
            for stage, spent in stages.timings_ms().items():
                self.metrics.stages.observe(spent / 1000, wire, stage)
        if self._traces is not None and seen is not None and seen.span is not None:
            self._traces.stages(seen.span, stages.over, failed)

    def _end(self, seen: Seen, seconds: float) -> None:
        self.metrics.under_way.add(-1, seen.wire)
        self.metrics.requests.add(1, seen.wire, seen.operation, seen.outcome)
        self.metrics.durations.observe(seconds, seen.wire, seen.operation)
        facts = seen.facts()
        if self._traces is not None and seen.span is not None:
            failure = None if seen.outcome == "ok" else seen.outcome
            self._traces.end(seen.span, seen.operation, facts, failure)
        model = f" by {facts['model']}" if "model" in facts else ""
        log.info(
            "%s %s %s for %s: %s%s in %.1f ms",
            seen.request_id, seen.wire, seen.operation, seen.caller or "-", seen.outcome, model, seconds * 1000,
            extra={"facts": facts | {"duration_ms": round(seconds * 1000, 3)}},
        )  # fmt: skip


class Stages:
    """A clock that is told when a stage begins, and tells the caller."""

    def __init__(self, on_stage: OnStage) -> None:
        self._on_stage = on_stage
        self._wall = clock.time_ns() - clock.perf_counter_ns()
        self._begun: tuple[str, int] | None = None
        self.over: list[Stage] = []

    def begin(self, stage: str) -> None:
        """Ends the stage before, and begins this one."""
        self._on_stage(stage)
        self.end()
        self._begun = (stage, clock.perf_counter_ns())

    def end(self) -> None:
        """Ends the last stage; after that, nothing."""
        if self._begun is not None:
            name, began = self._begun
            self.over.append(Stage(name, self._wall + began, self._wall + clock.perf_counter_ns()))
            self._begun = None

    def timings_ms(self) -> dict[str, float]:
        """Milliseconds of each stage that is over; a stage that began several times has their sum."""
        spent: dict[str, float] = {}
        for stage in self.over:
            spent[stage.name] = round(spent.get(stage.name, 0.0) + (stage.ended - stage.began) / 1e6, 3)
        return spent


def _name(error: BaseException) -> str:
    if isinstance(error, ShapeConceptsError):
        return error.type_name()
    return "cancelled" if isinstance(error, asyncio.CancelledError | GeneratorExit) else "internal"
