"""What a watcher is shown, whatever is published."""

from __future__ import annotations

import json
from typing import Any

import pytest
from rich.console import Console

from service.stream_table import MOST, Heard, StreamTable, read

JSON, PROBLEM = "application/json", "application/problem+json"
ANSWER = {
    "concepts": [{"id": 433, "name": "mug", "response": -23.5}],
    "novelty": 0.25,
    "dropped": 3,
    "source": {"sequence": 42, "time_ns": 10**18},
}


def heard(key: str = "a/concepts", document: Any = ANSWER, encoding: str = JSON) -> Heard:
    return read(key, encoding, json.dumps(document).encode(), 10**18 + 30_000_000)


def shown(*answers: Heard) -> str:
    table = StreamTable()
    for answer in answers:
        table.add(answer)
    console = Console(width=140, record=True, file=None, quiet=True)
    with console.capture() as capture:
        console.quiet = False
        console.print(table)
    return capture.get()


def test_a_line_says_what_was_answered_and_adds_up_what_was_dropped() -> None:
    line = next(line for line in shown(heard(), heard()).splitlines() if "a/concepts" in line)
    assert [cell.strip() for cell in line.strip("│").split("│")] == [
        "a/concepts", "42", "433 mug", "-23.500", "0.250", "2", "6", "30 ms",
    ]  # fmt: skip


def test_a_problem_is_told_in_its_words() -> None:
    assert "too few points" in shown(heard(document={"detail": "too few points"}, encoding=PROBLEM))


def test_robots_have_lines_of_their_own_and_the_silent_ones_give_way() -> None:
    text = shown(*(heard(f"robot/{number:03}") for number in range(MOST + 5)))
    assert "robot/004" not in text
    assert all(f"robot/{number:03}" in text for number in range(5, MOST + 5))


@pytest.mark.parametrize(
    "payload",
    [b"", b"{", b"[]", b"7", b"\xff\xfe", b"{}", b"[" * 100_000, b'{"concepts": 1, "source": [], "dropped": "x"}',
     b'{"concepts": [[]], "novelty": "[red]", "source": {"time_ns": "x", "sequence": {}}}',
     b'{"source": {"time_ns": 1}}'],
)  # fmt: skip
@pytest.mark.parametrize("encoding", [JSON, PROBLEM, "zenoh/bytes"])
def test_whatever_is_published_is_shown_somehow(payload: bytes, encoding: str) -> None:
    assert "a[b]/c" in shown(read("a[b]/c", encoding, payload, 10**18))


def test_nobody_steers_the_terminal() -> None:
    assert "\x1b" not in shown(
        heard("a\x1b[2J", {"detail": "\x1b]0;title\x07", "source": {"sequence": "\x1b["}}, PROBLEM)
    )


def test_clocks_that_do_not_agree_give_no_latency() -> None:
    assert heard(document={"source": {"time_ns": 2 * 10**18}}).latency is None
    assert heard(document={"source": {"time_ns": 0}}).latency is None
    assert heard().latency == pytest.approx(0.03)
