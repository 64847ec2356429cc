"""Answers of zenoh streams as they come in, as a table with a line for each robot."""

from __future__ import annotations

import json
from collections import OrderedDict
from typing import Any, NamedTuple

from rich.markup import escape
from rich.table import Table

from service.streams import latency_of

MOST = 40  # robots listed, those heard of last
PROBLEM = "application/problem+json"


class Heard(NamedTuple):
    """An answer, or a problem, as it came.

    Attributes:
        key: that it was published on.
        document: what it says; None if that cannot be read.
        problem: whether it is a problem document.
        latency: since the robot published the cloud, by the clocks of robot and watcher, seconds; None if unknown.
    """

    key: str
    document: dict[str, Any] | None
    problem: bool
    latency: float | None


def read(key: str, encoding: str, payload: bytes, now_ns: int) -> Heard:
    """What came on a key.

    Args:
        key: it came on.
        encoding: of the payload.
        payload: whatever somebody published.
        now_ns: when it came, nanoseconds since 1970.
    """
    try:
        document = json.loads(payload)
    except (ValueError, RecursionError):
        document = None
    if not isinstance(document, dict):
        return Heard(key, None, False, None)
    latency = latency_of(_part(document, "source", "time_ns"), now_ns)
    return Heard(key, document, encoding.startswith(PROBLEM), latency)


class StreamTable:
    """The last answer to each robot, and how many clouds were answered and dropped so far."""

    def __init__(self) -> None:
        self._rows: OrderedDict[str, Heard] = OrderedDict()
        self._answers: dict[str, int] = {}
        self._dropped: dict[str, int] = {}

    def add(self, heard: Heard) -> None:
        """Takes an answer in."""
        key, dropped = heard.key, _part(heard.document, "dropped")
        self._rows[key] = heard
        self._rows.move_to_end(key)
        self._answers[key] = self._answers.get(key, 0) + 1
        self._dropped[key] = self._dropped.get(key, 0) + (dropped if isinstance(dropped, int) else 0)
        if len(self._rows) > MOST:
            oldest, _ = self._rows.popitem(last=False)
            del self._answers[oldest], self._dropped[oldest]

    def __rich__(self) -> Table:
        """The table; Ctrl-C ends it."""
        table = Table(caption="Ctrl-C to end" if self._rows else "nothing yet; Ctrl-C to end", caption_justify="left")
        table.add_column("key", overflow="fold")
        for heading in ("sequence", "best concept", "response", "novelty", "answers", "dropped", "latency"):
            table.add_column(heading, justify="right")
        for key, heard in sorted(self._rows.items()):
            latency = "-" if heard.latency is None else f"{heard.latency * 1000:.0f} ms"
            counts = (str(self._answers[key]), str(self._dropped[key]), latency)
            sequence = _part(heard.document, "source", "sequence")
            table.add_row(_short(key, 300), "-" if sequence is None else _short(sequence), *_said(heard), *counts)
        return table


def _said(heard: Heard) -> tuple[str, str, str]:
    """Best concept, response and novelty; or what is wrong."""
    if heard.document is None:
        return "[red]not an answer[/]", "", ""
    if heard.problem:
        return f"[red]{_short(heard.document.get('detail'), 200)}[/]", "", ""
    if isinstance(objects := heard.document.get("objects"), list):
        return f"{len(objects)} objects", "", ""
    name, number = (_part(heard.document, "concepts", 0, part) for part in ("name", "id"))
    return (
        _short(number if name is None else f"{number} {name}"),
        _number(_part(heard.document, "concepts", 0, "response")),
        _number(heard.document.get("novelty")),
    )


def _part(document: Any, *path: str | int) -> Any:
    """A part of a document that anybody may have written, or None."""
    for step in path:
        try:
            document = document[step]
        except (TypeError, KeyError, IndexError):
            return None
    return document


def _short(value: Any, most: int = 40) -> str:
    """A value as somebody wrote it; what would steer the terminal is taken out."""
    return escape("".join(letter if letter.isprintable() else "?" for letter in str(value)[:most]))


def _number(value: Any) -> str:
    return f"{value:.3f}" if isinstance(value, int | float) else "-"
