"""The picture of F and of the concepts that it falls into."""

from __future__ import annotations

import re

import numpy as np
import pytest

from tests.worker.evaluation.figures.reports import LABELS, colours_in, group, structure
from worker.evaluation.figures.annexation import annexation_figure, component
from worker.evaluation.figures.palette import Palette

PALETTE = Palette(LABELS)


def curves(picture: str, key: str) -> list[str]:
    """The curves of a group of edges: what begins with a move."""
    return [part for path in group(picture, key) for part in re.findall(r"M [^M]*", path.get("d") or "")]


@pytest.mark.parametrize("size", [2, 3, 60])
def test_annexations_up_to_epsilon_max_are_solid_and_later_ones_dashed(size: int) -> None:
    of = structure(size)
    early = int((np.array(of.time) <= of.epsilon_max).sum())
    figure = annexation_figure(of, PALETTE)
    picture = figure.panels[0].picture
    assert len(curves(picture, "annexation-early")) == early
    assert len(curves(picture, "annexation-late")) == size - 1 - early
    assert all("dasharray" in (path.get("style") or "") for path in group(picture, "annexation-late"))


def test_earlier_annexations_are_thicker() -> None:
    of = structure(60)
    picture = annexation_figure(of, PALETTE).panels[0].picture
    styles = [path.get("style") or "" for path in group(picture, "annexation-early")]
    widths = [float(width[1]) if (width := re.search(r"stroke-width: ([\d.]+)", style)) else 1.0 for style in styles]
    assert widths == sorted(widths, reverse=True)  # they are drawn in the order of their times
    assert widths[0] > widths[-1]


def test_a_concept_is_drawn_with_the_annexations_between_its_members() -> None:
    of = structure(60)
    for place in range(len(of.concepts)):
        members = np.flatnonzero(np.array(of.assignment) == place).tolist()
        picture = component(of, members, f"part-{place}", "a part", PALETTE)
        assert len(curves(picture, f"part-{place}-edges")) == len(members) - 1
        wanted = {PALETTE.mark(of.labels[member]).colour for member in members}
        assert colours_in(picture) & {PALETTE.mark(label).colour for label in LABELS} == wanted
