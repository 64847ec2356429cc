"""What every figure of the report consists of."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

from markupsafe import Markup

from worker.evaluation.figures.palette import Palette


class Entry(NamedTuple):
    """A line of a legend: a label and how it is drawn."""

    label: str
    colour: str
    marker: str


class Panel(NamedTuple):
    """One picture of a figure.

    Attributes:
        picture: SVG or HTML.
        heading: short, above the picture; empty where it is the only one.
        note: what else must be known to read it; empty where nothing is.
    """

    picture: Markup
    heading: str = ""
    note: str = ""


class Table(NamedTuple):
    """Figures as text.

    Attributes:
        headings: of the columns; the first is that of the rows' names.
        rows: as many cells each; the first is its name.
        heading: short, above the table; empty where the figure's title is enough.
        shades: of each row, for each cell but the first, how dark it is, in [0, 1]; empty for none.
    """

    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    heading: str = ""
    shades: tuple[tuple[float, ...], ...] = ()


class Thumbnail(NamedTuple):
    """A small picture of a prototype: its image as a data address, what it is in words, the colour of its label."""

    image: str
    alt: str
    colour: str


class Card(NamedTuple):
    """A concept: its name, what it is in words, its part of F, its prototypes, and how many of them are not shown."""

    title: str
    summary: str
    picture: Markup
    thumbnails: tuple[Thumbnail, ...]
    left_out: int


@dataclass(frozen=True)
class Figure:
    """A figure of the report.

    Attributes:
        key: its address in the page.
        title: what it is called.
        caption: one plain sentence on what it shows, and how to read it.
        panels: its pictures.
        tables: below the pictures.
        cards: below the tables.
        legend: of its colours.
        scale: what the two ends of the scale of colours mean; empty where there is no such scale.
        paper: where the paper has it; empty where it has none.
        left_out: what is not drawn because there is too much of it; empty where everything is drawn.
        columns: how many panels stand side by side where there is room.
    """

    key: str
    title: str
    caption: str
    panels: tuple[Panel, ...] = ()
    tables: tuple[Table, ...] = ()
    cards: tuple[Card, ...] = ()
    legend: tuple[Entry, ...] = ()
    scale: tuple[str, ...] = ()
    paper: str = ""
    left_out: str = ""
    columns: int = 2


def legend_of(labels: Iterable[str | None], palette: Palette) -> tuple[Entry, ...]:
    """The legend of the labels that occur, in the palette's order; what has no colour of its own is last."""
    present = set(labels)
    entries = [Entry(label, *palette.mark(label)[:2]) for label in palette.labels if label in present]
    rest = present - set(palette.labels)
    named = [Entry(label, *palette.mark(label)[:2]) for label in sorted(filter(None, rest))]
    return (*entries, *named, *([Entry("no label", *palette.mark(None)[:2])] if None in rest else []))
