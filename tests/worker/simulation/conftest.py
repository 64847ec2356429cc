"""What the tests of the simulation share."""

from __future__ import annotations

import pytest

from worker.simulation.scene import unavailable


@pytest.fixture(scope="session")
def sapien() -> None:
    """Lets a test run where SAPIEN can render, and says why it is skipped elsewhere."""
    if reason := unavailable():
        pytest.skip(reason)
