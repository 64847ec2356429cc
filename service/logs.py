"""The log: lines for people, or JSON for programs, each with the request that it is about."""

from __future__ import annotations

import json
import logging
from datetime import UTC, datetime
from typing import Literal

from service.telemetry import current

TEXT = "%(asctime)s %(levelname)s %(name)s %(message)s"


def set_up(level: str, form: Literal["text", "json"]) -> None:
    """Has everything from a severity on logged to stderr.

    Args:
        level: debug, info, warning or error.
        form: "text", or "json": one JSON object a line.
    """
    handler = logging.StreamHandler()
    handler.setFormatter(JsonLines() if form == "json" else logging.Formatter(TEXT))
    logging.basicConfig(level=level.upper(), handlers=[handler])


class JsonLines(logging.Formatter):
    """Each record as a JSON object on one line: time, level, logger, message, and what is known of the request.

    Of a request's last line that is `request_id`, `wire`, `operation`, `outcome`, `caller`, `model`, `trace_id` and
    `duration_ms`; of others written while it is under way, what is known by then. A traceback is in `traceback`.
    """

    def format(self, record: logging.LogRecord) -> str:
        """The line."""
        line = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        if facts := getattr(record, "facts", None):
            line |= facts
        elif seen := current():
            line |= {name: value for name, value in seen.facts().items() if name != "outcome"}
        if record.exc_info:
            line["traceback"] = self.formatException(record.exc_info)
        return json.dumps(line)
