"""F, the graph of annexations, and its components, which are the concepts. Sec. Topological Filtration."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from numpy.typing import NDArray

from worker.evaluation.figures.drawing import WIDTH, draw
from worker.evaluation.figures.figure import Figure, Panel, legend_of
from worker.evaluation.figures.graphs import MOST, curves, fit, paint_alike, paint_each, paint_labelled
from worker.evaluation.figures.layout import inner, on_rings, rooted
from worker.evaluation.figures.palette import INK, PALE, Palette
from worker.evaluation.report import Structure

SIDE = float(WIDTH)  # of the picture, which is square, CSS pixels
MOST_OF_PART = 150  # vertices of a concept that are drawn, as the picture on its card is small
THICKEST, THINNEST = 2.6, 0.8  # of curves that join concepts, CSS pixels
ROOMY = 250  # vertices among which such curves do not touch


def annexation_figure(structure: Structure, palette: Palette) -> Figure:
    """F on rings about the prototype that is never annexed: edges by their times, those after epsilon_max faint."""
    size, time = len(structure.keys), np.array(structure.time)
    earliest_first = np.argsort(time, kind="stable")
    edges = np.stack([structure.annexed, structure.annexing], axis=1).astype(np.int64)[earliest_first]
    time = time[earliest_first]
    survivor = int(np.setdiff1d(np.arange(size), structure.annexed)[0])
    drawn = inner(rooted(edges, size, survivor), MOST)
    edges, kept = _among(edges, drawn, size)
    time = time[kept]
    places = on_rings(rooted(edges, len(drawn), int(np.searchsorted(drawn, survivor))))
    labels = [structure.labels[vertex] for vertex in drawn]

    def paint(axes: Axes) -> None:
        fit(axes, places, SIDE, SIDE)
        late = time > structure.epsilon_max
        paths = curves(places, edges)
        paint_alike(axes, [p for p, cut in zip(paths, late, strict=True) if cut], "late", PALE, 0.6, dashed=True)
        early = [p for p, cut in zip(paths, late, strict=True) if not cut]
        paint_each(axes, early, "early", INK, _width(time[~late], structure.epsilon_max, len(drawn)))
        paint_labelled(axes, places, labels, palette, _dot(len(drawn)))

    alt = f"{len(drawn)} dots on rings, joined by curves: who annexed whom, up to time {structure.epsilon_max:.2f}."
    labelled = any(label is not None for label in structure.labels)
    return Figure(
        key="annexation",
        title="The annexation graph F: which group swallowed which",
        caption="Groups of alike objects grow until one is left: a curve leads inwards from an object whose group was "
        "swallowed to the one whose group swallowed it, the thicker the earlier. What the solid curves join is a "
        f"concept; the dashed ones came after time ε max = {structure.epsilon_max:.2f} and are cut.",
        panels=(Panel(draw("annexation", alt, SIDE, paint, frame=False)),),
        legend=legend_of(labels, palette) if labelled else (),
        paper="filtration result F of Sec. Topological Filtration",
        left_out=f"The {size - len(drawn)} outermost dots of {size} are not drawn." if len(drawn) < size else "",
        columns=1,
    )


def component(structure: Structure, members: Sequence[int], key: str, alt: str, palette: Palette) -> Markup:
    """A concept: its members, and the edges of F between them that are not later than epsilon_max.

    Args:
        structure: of the model.
        members: vertices of one concept, ascending.
        key: of the picture.
        alt: what it shows.
        palette: of the labels.
    """
    chosen = np.array(members, np.int64)
    time = np.array(structure.time)
    early = np.flatnonzero(time <= structure.epsilon_max)
    early = early[np.argsort(time[early], kind="stable")]
    edges = np.stack([structure.annexed, structure.annexing], axis=1).astype(np.int64)[early]
    edges, _ = _among(edges, chosen, len(structure.keys))
    root = int(np.setdiff1d(np.arange(len(chosen)), edges[:, 0])[0])
    drawn = inner(rooted(edges, len(chosen), root), MOST_OF_PART)
    edges, _ = _among(edges, drawn, len(chosen))
    places = on_rings(rooted(edges, len(drawn), int(np.searchsorted(drawn, root))))

    def paint(axes: Axes) -> None:
        radius = float(np.clip(0.16 * SIDE / np.sqrt(len(drawn)), 4, 18))  # the card shows it at a quarter of the size
        fit(axes, places, SIDE, SIDE, 1.2 * radius)
        paint_alike(axes, curves(places, edges), "edges", PALE, 4.0)
        paint_labelled(axes, places, [structure.labels[vertex] for vertex in chosen[drawn]], palette, radius)

    return draw(key, alt, SIDE, paint, frame=False)


def _among(
    edges: NDArray[np.int64], drawn: NDArray[np.int64], size: int
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """The edges between vertices that are drawn, by their places among those, and which of all edges they are."""
    place_of = np.full(size, -1, np.int64)
    place_of[drawn] = np.arange(len(drawn))
    kept = np.asarray((place_of[edges] >= 0).all(axis=1))
    return place_of[edges[kept]], kept


def _width(time: NDArray[np.float64], last: float, count: int) -> NDArray[np.float64]:
    """Of the curves of annexations, the thicker the earlier, and thinner where there are many, CSS pixels."""
    share = time / last if last > 0 else np.zeros(len(time))
    return (THICKEST - (THICKEST - THINNEST) * share) * min(1.0, np.sqrt(ROOMY / count))


def _dot(count: int) -> float:
    """Radius of so many vertices on a picture of 360 x 360, CSS pixels."""
    return float(np.clip(0.09 * SIDE / np.sqrt(max(count, 1)), 1.2, 4.0))
