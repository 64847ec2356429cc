"""Colours: the same one for the same label in all figures, told apart by colour-blind eyes too."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from worker.evaluation.labels import OTHER
from worker.evaluation.report import Report

# Stand for the page's own colours, which are others by night; the page knows them as --ink and so on.
INK, PALE, PAPER, ACCENT = "#0a0b0c", "#8a8b8c", "#fafbfc", "#5a2ca1"
PAGE_COLOURS = {INK: "var(--ink)", PALE: "var(--pale)", PAPER: "var(--paper)", ACCENT: "var(--accent)"}

# Okabe and Ito, Color Universal Design, 2008, without black, which cannot be seen by night.
COLOURS = ("#0072b2", "#e69f00", "#009e73", "#d55e00", "#56b4e9", "#cc79a7", "#f0e442")
MARKERS = ("o", "s", "^", "D", "v", "P")  # names of matplotlib
ABSENT = "#999999"  # of what has no label, or none that is a category
FAINTEST = 0.08  # opacity of the accent at the lower end of a scale


class Mark(NamedTuple):
    """How a label is drawn.

    Attributes:
        colour: hexadecimal.
        marker: name of matplotlib.
        hatch: of areas; what tells labels apart once the colours are used up.
    """

    colour: str
    marker: str
    hatch: str


@dataclass(frozen=True)
class Palette:
    """The labels that have a colour of their own, in the order in which the colours went round."""

    labels: tuple[str, ...]

    def mark(self, label: str | None) -> Mark:
        """How a label is drawn; None stands for no label."""
        if label not in self.labels:
            return Mark(ABSENT, ".", "")
        place = self.labels.index(label)
        hatch = ("", "///", "...", "xxx")[place // len(COLOURS) % 4]
        return Mark(COLOURS[place % len(COLOURS)], MARKERS[place % len(MARKERS)], hatch)


def palette_of(report: Report) -> Palette:
    """The colours of all labels of a report: those that are judged first, each kind in alphabetical order."""
    prototypes = report.structure.labels if report.structure else []
    known = {*report.data.not_judged, *(label for label in prototypes if label is not None)}
    for other in report.others:
        known |= {*other.data.categories, *other.data.not_judged}
    judged = sorted(report.data.categories)
    return Palette((*judged, *sorted(known - {*judged, OTHER})))
