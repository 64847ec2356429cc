"""Spans as they reach a collector that speaks OTLP over HTTP."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest
from opentelemetry.proto.collector.trace.v1.trace_service_pb2 import ExportTraceServiceRequest
from opentelemetry.proto.trace.v1.trace_pb2 import Span, Status

from service.application import Application, CloudFile
from service.engine.errors import TooFewPoints
from service.settings import Settings
from service.telemetry import Telemetry
from service.traces import from_environment
from service.transports.rest.examples import CLOUD_XYZ

TRACE, PARENT = "4bf92f3577b34da6a3ce929d0e0e4736", "00f067aa0ba902b7"  # the example of W3C's recommendation


class Collector:
    """Spans that were received, and where."""

    def __init__(self, endpoint: str) -> None:
        self.endpoint = endpoint
        self.bodies: list[bytes] = []

    def spans(self) -> list[Span]:
        requests = [ExportTraceServiceRequest.FromString(body) for body in self.bodies]
        scopes = [
            scope for request in requests for resource in request.resource_spans for scope in resource.scope_spans
        ]
        return [span for scope in scopes for span in scope.spans]

    def service(self) -> str:
        resource = ExportTraceServiceRequest.FromString(self.bodies[0]).resource_spans[0].resource
        return next(each.value.string_value for each in resource.attributes if each.key == "service.name")


@contextmanager
def collecting() -> Iterator[Collector]:
    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            assert self.path == "/v1/traces"
            collector.bodies.append(self.rfile.read(int(self.headers["content-length"])))
            self.send_response(200)
            self.send_header("content-length", "0")
            self.end_headers()

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        collector = Collector(f"http://127.0.0.1:{server.server_port}")
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield collector
        server.shutdown()
        thread.join()


@pytest.fixture
def collector(monkeypatch: pytest.MonkeyPatch) -> Iterator[Collector]:
    """A collector to which the environment sends spans."""
    with collecting() as collector:
        monkeypatch.setenv("OTEL_EXPORTER_OTLP_ENDPOINT", collector.endpoint)
        yield collector


def attributes(span: Span) -> dict[str, str]:
    return {each.key: each.value.string_value for each in span.attributes}


def test_a_request_is_a_span_with_a_child_for_each_stage(collector: Collector, settings: Settings) -> None:
    application = Application(settings, Telemetry(from_environment()))
    carrier = {"traceparent": f"00-{TRACE}-{PARENT}-01"}
    with application.telemetry.request("rest", "id-7", "POST /v1/responses", carrier) as seen:
        answer = application.respond(CloudFile(CLOUD_XYZ.encode(), "xyz"))
    application.close()
    assert seen.trace_id == TRACE
    *stages, request = collector.spans()
    assert [stage.name for stage in stages] == list(answer.timings_ms)
    assert (request.name, request.kind) == ("POST /v1/responses", Span.SPAN_KIND_SERVER)
    assert (request.trace_id.hex(), request.parent_span_id.hex()) == (TRACE, PARENT)
    assert attributes(request) == {
        "shape_concepts.request_id": "id-7",
        "shape_concepts.wire": "rest",
        "shape_concepts.operation": "POST /v1/responses",
        "shape_concepts.outcome": "ok",
        "shape_concepts.model": "tiny:1",
        "shape_concepts.trace_id": TRACE,
    }
    assert collector.service() == "shape-concepts"
    ends = request.start_time_unix_nano
    for stage in stages:
        assert stage.parent_span_id == request.span_id
        assert ends <= stage.start_time_unix_nano <= stage.end_time_unix_nano <= request.end_time_unix_nano
        ends = stage.end_time_unix_nano
        spent = (stage.end_time_unix_nano - stage.start_time_unix_nano) / 1e6
        assert spent == pytest.approx(answer.timings_ms[stage.name], abs=0.001)


def test_a_failure_is_marked_on_the_request_and_on_its_stage(collector: Collector, settings: Settings) -> None:
    application = Application(settings, Telemetry(from_environment()))
    with pytest.raises(TooFewPoints), application.telemetry.request("grpc", "1", "Respond"):
        application.respond(CloudFile(b"1 2 3\n4 5 6\n", "xyz"))
    application.close()
    *stages, request = collector.spans()
    assert request.status.code == stages[-1].status.code == Status.STATUS_CODE_ERROR
    assert attributes(request)["error.type"] == "too-few-points"
    assert not request.parent_span_id


def test_a_traceparent_that_is_none_begins_a_trace_of_its_own(collector: Collector) -> None:
    telemetry = Telemetry(from_environment())
    for nonsense in ("", "00-xyz-1-01", "é" * 9999, f"00-{'0' * 32}-{PARENT}-01"):
        with telemetry.request("rest", "1", carrier={"traceparent": nonsense, "tracestate": "==,;"}):
            pass
    telemetry.close()
    spans = collector.spans()
    assert len({span.trace_id for span in spans}) == 4
    assert not any(span.parent_span_id for span in spans)


def test_without_a_collector_nothing_is_traced(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("OTEL_EXPORTER_OTLP_ENDPOINT", "OTEL_EXPORTER_OTLP_TRACES_ENDPOINT"):
        monkeypatch.delenv(name, raising=False)
    assert from_environment() is None
    monkeypatch.setenv("OTEL_EXPORTER_OTLP_ENDPOINT", "http://127.0.0.1:9")
    monkeypatch.setenv("OTEL_SDK_DISABLED", "true")
    assert from_environment() is None


def test_a_collector_that_is_away_holds_nobody_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OTEL_EXPORTER_OTLP_ENDPOINT", "http://127.0.0.1:9")
    monkeypatch.setenv("OTEL_EXPORTER_OTLP_TIMEOUT", "1")
    telemetry = Telemetry(from_environment())
    with telemetry.request("rest", "1") as seen:
        pass
    assert seen.outcome == "ok"
    telemetry.close()


def test_where_the_extra_is_not_installed_it_is_said() -> None:
    code = (
        "import logging, sys\nlogging.basicConfig()\n"
        "for name in ('opentelemetry.sdk', 'opentelemetry.exporter'): sys.modules[name] = None\n"
        "import service.main\nfrom service.traces import from_environment\nassert from_environment() is None"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code],
        env={"OTEL_EXPORTER_OTLP_ENDPOINT": "http://127.0.0.1:4318", "PYTHONPATH": ":".join(sys.path)},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    assert "pip install 'shape-concepts[traces]'" in ended.stderr
