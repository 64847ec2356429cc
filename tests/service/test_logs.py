"""The log as programs read it."""

from __future__ import annotations

import json
import logging
import sys
from datetime import datetime

from service.logs import JsonLines
from service.telemetry import Telemetry


def line(message: str, *arguments: object, fault: bool = False) -> dict[str, object]:
    """A record as it is written: one line."""
    record = logging.LogRecord(
        "service.x", logging.WARNING, "x.py", 1, message, arguments, sys.exc_info() if fault else None
    )
    text = JsonLines().format(record)
    assert "\n" not in text
    document: dict[str, object] = json.loads(text)
    return document


def test_a_line_says_when_what_and_how_grave() -> None:
    written = line("going on\nwith %s", "ünïcode \u2028")
    assert written["message"] == "going on\nwith ünïcode \u2028"
    assert (written["level"], written["logger"]) == ("warning", "service.x")
    assert datetime.fromisoformat(str(written["time"])).tzinfo is not None


def test_a_line_says_which_request_it_is_about() -> None:
    assert "request_id" not in line("before")
    with Telemetry().request("grpc", "id-7", "Respond") as seen:
        seen.caller = "0123456789ab"
        written = line("slow")
    assert {name: written[name] for name in ("request_id", "wire", "operation", "caller")} == {
        "request_id": "id-7",
        "wire": "grpc",
        "operation": "Respond",
        "caller": "0123456789ab",
    }
    assert "outcome" not in written  # it is not known yet


def test_a_fault_is_told_whole_on_the_same_line() -> None:
    try:
        raise RuntimeError("inside")
    except RuntimeError:
        written = line("unexpected", fault=True)
    assert "RuntimeError: inside" in str(written["traceback"])
    assert "test_logs.py" in str(written["traceback"])
