"""The concepts: what each consists of, and how well it goes with labels. Sec. Unsupervised Concept Selection."""

from __future__ import annotations

import base64
from collections import Counter
from io import BytesIO

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray
from PIL import Image

from worker.evaluation.figures.annexation import MOST_OF_PART, component
from worker.evaluation.figures.drawing import draw
from worker.evaluation.figures.figure import Card, Figure, Panel, Thumbnail, legend_of
from worker.evaluation.figures.palette import ABSENT, ACCENT, Palette
from worker.evaluation.report import ConceptPurity, Grouping, Structure

CARDS, SHOWN = 30, 24  # concepts, and prototypes of each, of which there are pictures
BARS = 48  # concepts that are ranked in one picture
NUMBERED = 24  # bars that have room for a number
HEIGHT = 260.0  # CSS pixels


def concept_figure(
    structure: Structure, thumbnails: NDArray[np.uint8], embedded: NDArray[np.float64], palette: Palette
) -> Figure:
    """Each concept with its part of F and pictures of its prototypes.

    Args:
        structure: of the model, with N prototypes.
        thumbnails: (N, 48, 48), 0 is background.
        embedded: (N, k): the prototypes in the metric's coordinates; those nearest to their mean are shown first.
        palette: of the labels.
    """
    assignment = np.array(structure.assignment, np.int64)
    cards = []
    for place, identity in enumerate(structure.concepts[:CARDS]):
        members = np.flatnonzero(assignment == place)
        heart = np.linalg.norm(embedded[members] - embedded[members].mean(axis=0), axis=1).argsort(kind="stable")
        first = members[heart][:SHOWN]
        alt = f"Concept {identity}: {len(members)} dots joined as they annexed one another."
        cards.append(
            Card(
                title=f"Concept {identity}",
                summary=_summary([structure.labels[member] for member in members]),
                picture=component(structure, members.tolist(), f"concept-{place}", alt, palette),
                thumbnails=tuple(_thumbnail(structure, thumbnails, member, palette) for member in first.tolist()),
                left_out=len(members) - len(first),
            )
        )
    single = int((assignment < 0).sum())
    labelled = any(label is not None for label in structure.labels)
    largest = int(np.bincount(assignment[assignment >= 0]).max(initial=0))
    more = len(structure.concepts) - len(cards)
    return Figure(
        key="concepts",
        title="The concepts: groups of objects that belong together",
        caption="A concept is a group that the strong curves of the annexation graph join. Each card shows a concept's "
        "part of that graph, and its objects as the sensor saw them, the most typical first"
        + ("; frames have the colours of labels." if labelled else ".")
        + (f" {single} of {len(assignment)} objects stand alone and belong to no concept." if single else ""),
        cards=tuple(cards),
        legend=legend_of(structure.labels, palette) if labelled else (),
        paper="concepts C of Sec. Extraction of Persistent Shape Concepts",
        left_out=" ".join(
            [f"The {more} smallest of {len(structure.concepts)} concepts are not shown."] * (more > 0)
            + [f"A card draws at most {MOST_OF_PART} dots of a graph."] * (largest > MOST_OF_PART)
        ),
    )


def ranked_figure(structure: Structure | None, grouping: Grouping | None, palette: Palette) -> Figure | None:
    """What share of each concept bears which label, in the order of Eq. 6; without labels, the concepts' sizes."""
    if grouping is not None:
        return _ranked_by_label(grouping, palette)
    return _ranked_by_size(structure) if structure is not None else None


def _ranked_by_label(grouping: Grouping, palette: Palette) -> Figure:
    largest = sorted(grouping.concepts, key=lambda concept: -concept.prototypes)[:BARS]
    concepts = sorted(largest, key=lambda concept: concept.rank_score)
    alt = (
        f"{len(concepts)} columns, one a concept, each divided into the shares of its labels; the purest at the right."
    )
    shares = [_shares_of(concept) for concept in concepts]
    left_out = len(grouping.concepts) - len(concepts)
    return Figure(
        key="ranked",
        title="Ranked concepts: does a concept go with one label?",
        caption=f"Each column is a concept, and its colours are the shares of the labels of its objects: "
        f"{grouping.pure:.0%} of the concepts are of one colour, and on average the largest share is "
        f"{grouping.purity:.2f}. The best, large and pure, stand at the right; a number is how many objects a concept "
        "has. Learning did not see the labels.",
        panels=(Panel(draw("ranked", alt, HEIGHT, lambda axes: _paint_shares(axes, concepts, shares, palette))),),
        legend=legend_of({label for share in shares for label in share}, palette),
        paper="ranked concepts of Sec. Unsupervised Concept Selection, Eq. 5 and 6",
        left_out=f"The {left_out} smallest of {len(grouping.concepts)} concepts are not drawn." if left_out > 0 else "",
        columns=1,
    )


def _ranked_by_size(structure: Structure) -> Figure:
    sizes = np.bincount([place for place in structure.assignment if place >= 0], minlength=len(structure.concepts))
    drawn = sizes[:BARS]

    def paint(axes: Axes) -> None:
        axes.bar(np.arange(1, len(drawn) + 1), drawn, color=ACCENT)
        axes.set_xlabel("concepts, largest first")
        axes.set_ylabel("objects")
        axes.xaxis.set_major_locator(MaxNLocator(8, integer=True))
        axes.yaxis.set_major_locator(MaxNLocator(5, integer=True))
        axes.grid(axis="x", visible=False)

    left_out = len(sizes) - len(drawn)
    return Figure(
        key="ranked",
        title="Ranked concepts: how large each is",
        caption="Each column is a concept, and its height is the number of objects in it. None of the objects is among "
        "the labelled clouds, so whether a concept goes with a label cannot be told.",
        panels=(
            Panel(draw("ranked", f"{len(drawn)} columns, the largest {drawn.max(initial=0)} high.", HEIGHT, paint)),
        ),
        paper="ranked concepts of Sec. Unsupervised Concept Selection",
        left_out=f"The {left_out} smallest of {len(sizes)} concepts are not drawn." if left_out > 0 else "",
        columns=1,
    )


def _shares_of(concept: ConceptPurity) -> dict[str | None, float]:
    """Of a concept's labelled prototypes, the share of each label."""
    if concept.labels:
        return {label: count / concept.prototypes for label, count in concept.labels.items()}
    return {concept.label: concept.purity, None: 1 - concept.purity}


def _paint_shares(
    axes: Axes, concepts: list[ConceptPurity], shares: list[dict[str | None, float]], palette: Palette
) -> None:
    column = np.arange(len(concepts))
    floor = np.zeros(len(concepts))
    present = {label for share in shares for label in share}
    for label in [
        *(label for label in palette.labels if label in present),
        *sorted(present - {*palette.labels}, key=str),
    ]:
        height = np.array([share.get(label, 0.0) for share in shares])
        mark = palette.mark(label)
        axes.bar(column, height, 0.82, floor, color=mark.colour, hatch=mark.hatch, linewidth=0)
        floor += height
    if len(concepts) <= NUMBERED:
        for place, concept in enumerate(concepts):
            axes.text(place, 1.02, str(concept.prototypes), ha="center", va="bottom", fontsize=10)
    axes.set_ylim(0, 1.0 if len(concepts) > NUMBERED else 1.1)
    axes.set_yticks(np.linspace(0, 1, 6))
    axes.set_xticks([])
    axes.set_xlabel("concepts, by ascending rank score")
    axes.set_ylabel("share of its objects")
    axes.grid(axis="x", visible=False)


def _summary(labels: list[str | None]) -> str:
    known = Counter(label for label in labels if label is not None)
    number = f"{len(labels)} objects"
    return f"{number}: {', '.join(f'{count} {label}' for label, count in known.most_common())}" if known else number


def _thumbnail(structure: Structure, thumbnails: NDArray[np.uint8], member: int, palette: Palette) -> Thumbnail:
    """A prototype as a grey PNG whose background is transparent."""
    shade = thumbnails[member]
    written = BytesIO()
    Image.fromarray(np.stack([shade, np.where(shade > 0, 255, 0).astype(np.uint8)], axis=2)).save(
        written, "PNG", optimize=True
    )
    label, key = structure.labels[member], structure.keys[member]
    return Thumbnail(
        image=f"data:image/png;base64,{base64.b64encode(written.getvalue()).decode()}",
        alt=f"{label}, {key}" if label is not None else key,
        colour=palette.mark(label).colour if label is not None else ABSENT,
    )
