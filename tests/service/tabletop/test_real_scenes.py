"""Real table tops: what stands free is found."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.benchmarks.scenes import OVERLAP, judge_all


@pytest.mark.data
def test_four_fifths_of_the_objects_that_stand_free_are_found(scans: Path) -> None:
    scenes = judge_all(scans / "scenes")
    assert len(scenes) == 12
    free = [one.overlap for scene in scenes for one in scene.objects if one.free]
    assert len(free) >= 20
    assert np.mean(np.array(free) >= OVERLAP) >= 0.8
    assert np.median(free) > 0.9
