"""The picture of the tree."""

from __future__ import annotations

import re

from tests.worker.evaluation.figures.reports import LABELS, colours_in, group, structure
from worker.evaluation.figures.graphs import MOST
from worker.evaluation.figures.palette import Palette
from worker.evaluation.figures.space import space_figure

PALETTE = Palette(LABELS)


def test_a_tree_without_labels_is_coloured_by_its_heat_alone() -> None:
    figure = space_figure(structure(30, (None,)), PALETTE)
    assert [panel.heading for panel in figure.panels] == ["Vertex heat, scaled and inverted"]
    assert figure.legend == ()
    assert not colours_in(figure.panels[0].picture) & {PALETTE.mark(label).colour for label in LABELS}


def test_a_labelled_tree_is_shown_by_its_labels_too() -> None:
    figure = space_figure(structure(30), PALETTE)
    assert colours_in(figure.panels[1].picture) >= {PALETTE.mark(label).colour for label in LABELS}
    assert [entry.label for entry in figure.legend] == list(LABELS)


def test_every_vertex_and_every_edge_is_drawn() -> None:
    picture = space_figure(structure(30), PALETTE).panels[1].picture
    assert len(re.findall(r"<use [^>]*>", picture)) == 30
    assert sum((path.get("d") or "").count("M") for path in group(picture, "space-labels-edges")) == 29


def test_two_prototypes_are_a_tree() -> None:
    assert space_figure(structure(2), PALETTE).left_out == ""


def test_of_a_huge_tree_only_as_much_is_drawn_as_can_be_seen_and_that_is_said() -> None:
    of = structure(MOST + 300)
    figure = space_figure(of, PALETTE)
    assert figure.left_out == f"The 300 outermost dots of {MOST + 300} are not drawn."
    assert sum(len(panel.picture) for panel in figure.panels) < 3e6
