"""The barcode, and annexations over time."""

from __future__ import annotations

import numpy as np

from tests.worker.evaluation.figures.reports import structure
from worker.evaluation.figures.filtration import SEPARATE, filtration_figure


def test_a_bar_a_prototype_and_the_busiest_time_are_told() -> None:
    of = structure(60)
    barcode, annexations = filtration_figure(of).panels
    times, counts = np.unique(of.time, return_counts=True)
    ended = int((np.array(of.time) <= of.epsilon_max).sum())
    assert f"60 bars from time 0 on, the shortest at the bottom; {ended} have ended" in barcode.picture
    assert f"most of them, {counts.max()}, at time {times[counts.argmax()]:.2f}" in annexations.picture
    for panel in (barcode, annexations):
        assert f"ε max = {of.epsilon_max:.2f}" in panel.picture


def test_bars_beyond_counting_are_blocks_of_those_that_end_together() -> None:
    few, many = structure(SEPARATE - 1), structure(3 * SEPARATE)
    sizes = [len(filtration_figure(of).panels[0].picture) for of in (few, many)]
    assert sizes[1] < sizes[0]


def test_two_prototypes_have_one_annexation() -> None:
    of = structure(2)
    assert "most of them, 1, at time" in filtration_figure(of).panels[1].picture
