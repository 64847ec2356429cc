"""What several tests share: where the real scans are, and whether they are there."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
ON_SCANS = pytest.StashKey[set[str]]()


def data_folder() -> Path:
    """The folder of real scans: SHAPE_CONCEPTS_DATA, or `shared/data` beside the project."""
    return Path(os.environ.get("SHAPE_CONCEPTS_DATA", ROOT.parent / "shared" / "data"))


@pytest.fixture(scope="session")
def scans() -> Path:
    folder = data_folder()
    if not (folder / "scans" / "labels.csv").is_file():
        pytest.skip(f"real scans are not at {folder}: set SHAPE_CONCEPTS_DATA to their folder")
    return folder


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    config.stash[ON_SCANS] = {item.nodeid for item in items if item.get_closest_marker("data")}


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Says how many tests on real scans were run, and how many were skipped for want of them."""
    on_scans = config.stash.get(ON_SCANS, set())
    counts = {
        outcome: sum(report.nodeid in on_scans for report in terminalreporter.getreports(outcome))
        for outcome in ("passed", "failed", "skipped")
    }
    run = counts["passed"] + counts["failed"]
    terminalreporter.write_line(f"tests on real scans: {run} run, {counts['skipped']} skipped")
