"""Spans for an OpenTelemetry collector: one a request, and below it one a stage.

They are sent where the standard variables say (`OTEL_EXPORTER_OTLP_ENDPOINT`, `OTEL_EXPORTER_OTLP_HEADERS`,
`OTEL_SERVICE_NAME`, ...), over OTLP/HTTP, and need the extra `traces`. This is the one module that imports
OpenTelemetry, and it does so when traces are wanted only.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from opentelemetry.sdk.trace import TracerProvider
    from opentelemetry.trace import Span

ENDPOINTS = ("OTEL_EXPORTER_OTLP_TRACES_ENDPOINT", "OTEL_EXPORTER_OTLP_ENDPOINT")

log = logging.getLogger(__name__)


class Stage(NamedTuple):
    """A stage of an answer that is over: when it began and ended, nanoseconds of the system's clock."""

    name: str
    began: int
    ended: int


class Traces:
    """Makes spans.

    Args:
        provider: what takes them.
    """

    def __init__(self, provider: TracerProvider) -> None:
        self._provider = provider
        self._tracer = provider.get_tracer("shape-concepts")

    def begin(self, wire: str, carrier: Mapping[str, str]) -> Span:
        """The span of a request; its parent is the client's, where the carrier has a W3C `traceparent`."""
        from opentelemetry.trace import SpanKind
        from opentelemetry.trace.propagation.tracecontext import TraceContextTextMapPropagator

        parent = TraceContextTextMapPropagator().extract(carrier)
        return self._tracer.start_span(wire, parent, SpanKind.SERVER, {"shape_concepts.wire": wire})

    def stages(self, span: Span, stages: Sequence[Stage], failed: bool) -> None:
        """Adds the stages of an answer to the span of its request; the last is the one that failed, if any did."""
        from opentelemetry.trace import StatusCode, set_span_in_context

        parent = set_span_in_context(span)
        for number, stage in enumerate(stages, start=1):
            child = self._tracer.start_span(stage.name, parent, start_time=stage.began)
            if failed and number == len(stages):
                child.set_status(StatusCode.ERROR)
            child.end(stage.ended)

    def end(self, span: Span, name: str, facts: Mapping[str, Any], failure: str | None) -> None:
        """Ends the span of a request, with its name, what is known of it, and the name of the error if it failed."""
        from opentelemetry.trace import StatusCode

        span.update_name(name)
        span.set_attributes({f"shape_concepts.{key}": value for key, value in facts.items()})
        if failure is not None:
            span.set_attribute("error.type", failure)
            span.set_status(StatusCode.ERROR, failure)
        span.end()

    def trace_id(self, span: Span) -> str:
        """Of the trace that a span is part of, hexadecimal."""
        return f"{span.get_span_context().trace_id:032x}"

    def close(self) -> None:
        """Sends what was not sent yet."""
        self._provider.shutdown()


def from_environment() -> Traces | None:
    """Traces, where the standard variables ask for them; says so where they do and the extra is not installed."""
    endpoint = next((os.environ[name] for name in ENDPOINTS if os.environ.get(name)), None)
    disabled = os.environ.get("OTEL_SDK_DISABLED", "").lower() == "true"
    if endpoint is None or disabled or os.environ.get("OTEL_TRACES_EXPORTER") == "none":
        return None
    try:
        from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
        from opentelemetry.sdk.resources import SERVICE_NAME, OTELResourceDetector, Resource
        from opentelemetry.sdk.trace import TracerProvider
        from opentelemetry.sdk.trace.export import BatchSpanProcessor
    except ImportError as error:
        log.warning(
            "no traces: the environment asks for them (%s), but %s is not installed; "
            "install it with pip install 'shape-concepts[traces]'", endpoint, error.name,
        )  # fmt: skip
        return None
    named = Resource({SERVICE_NAME: "shape-concepts"}).merge(OTELResourceDetector().detect())
    provider = TracerProvider(resource=named)
    provider.add_span_processor(BatchSpanProcessor(OTLPSpanExporter()))
    log.info("traces go to %s", endpoint)
    return Traces(provider)
