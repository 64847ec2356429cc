"""What several tests share: where the real scans are, and whether they are there."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
ON_SCANS = ("data", "real scans")  # the property of a test that needs them


def data_folder() -> Path:
    """The folder of real scans: SHAPE_CONCEPTS_DATA, or `shared/data` beside the project."""
    return Path(os.environ.get("SHAPE_CONCEPTS_DATA", ROOT.parent / "shared" / "data"))


@pytest.fixture(scope="session")
def scans() -> Path:
    folder = data_folder()
    if not (folder / "scans" / "labels.csv").is_file():
        pytest.skip(f"real scans are not at {folder}: set SHAPE_CONCEPTS_DATA to their folder")
    return folder


def pytest_configure() -> None:
    """Lets processes of tests hear Ctrl-C, though a shell that started this in the background has it ignored."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if item.get_closest_marker("data"):
            item.user_properties.append(ON_SCANS)  # goes with the report, from a worker process too


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Says how many tests on real scans were run, and how many were skipped for want of them."""
    counts = {
        outcome: sum(
            ON_SCANS in map(tuple, getattr(report, "user_properties", ()))
            for report in terminalreporter.getreports(outcome)
        )
        for outcome in ("passed", "failed", "skipped")
    }
    run = counts["passed"] + counts["failed"]
    terminalreporter.write_line(f"tests on real scans: {run} run, {counts['skipped']} skipped")
