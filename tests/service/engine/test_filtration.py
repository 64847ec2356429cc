"""What is read off a filtration."""

from __future__ import annotations

import numpy as np
import pytest

from service.engine.filtration import Filtration, annexations_over_time, barcode, time_step

FILTRATION = Filtration(
    distance=np.array([0.4, 0.1, 0.9, 0.1]),
    time=np.array([0.5, 0.0, 1.0, 0.0]),
    order=np.array([2, 0, 3, 1]),
    annexed=np.array([0, 1, 2, 3]),
    annexing=np.array([1, 2, 4, 4]),
    epsilon_max=0.0,
)


def test_annexations_are_counted_at_each_time_that_saw_any():
    times, counts = annexations_over_time(FILTRATION)
    assert times.tolist() == [0.0, 0.5, 1.0]
    assert counts.tolist() == [2, 1, 1]


def test_all_bars_begin_at_0_and_one_never_ends():
    assert barcode(FILTRATION).tolist() == [[0, 0], [0, 0], [0, 0.5], [0, 1.0], [0, np.inf]]


def test_the_step_is_the_smallest_distance_unless_there_were_too_many():
    assert time_step(FILTRATION.distance, 100) == pytest.approx(0.1 / 0.8)
    assert time_step(FILTRATION.distance, 4) == pytest.approx(1 / 4)
    assert time_step(np.array([0.3, 0.3]), 100) == 1
