"""What the tests of the simulation share."""

from __future__ import annotations

import pytest

from worker.simulation.scene import unavailable


@pytest.fixture(scope="session")
def sapien() -> None:
    """Lets a test run where SAPIEN can render, and says why it is skipped elsewhere."""
    if reason := unavailable():
        # A Python error in the trial is a fault of ours, not of the machine: to skip would hide it.
        assert "ended with code 1 " not in reason, reason
        pytest.skip(reason)
