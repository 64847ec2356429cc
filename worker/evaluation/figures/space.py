"""The topological space X: the minimum spanning tree of the prototypes. Sec. Topological Space Generation."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from worker.evaluation.figures.drawing import WIDTH, draw
from worker.evaluation.figures.figure import Figure, Panel, legend_of
from worker.evaluation.figures.graphs import (
    MOST,
    fit,
    height_for,
    lines,
    paint_alike,
    paint_labelled,
    paint_shaded,
    radius_for,
)
from worker.evaluation.figures.layout import inner, rooted, unfolded
from worker.evaluation.figures.palette import PALE, Palette
from worker.evaluation.report import Structure


def space_figure(structure: Structure, palette: Palette) -> Figure:
    """The tree, its vertices coloured by their heat, and by their labels where they have one."""
    heat = np.array(structure.heat)
    edges = np.array(structure.edges, np.int64).reshape(-1, 2)
    drawn = inner(rooted(edges, len(heat), int(heat.argmin())), MOST)
    place_of = np.full(len(heat), -1, np.int64)
    place_of[drawn] = np.arange(len(drawn))
    edges = place_of[edges]
    edges = edges[(edges >= 0).all(axis=1)]
    places = unfolded(rooted(edges, len(drawn), int(heat[drawn].argmin())))
    height = height_for(places)

    def paint_heat(axes: Axes) -> None:
        radius = _paint_edges(axes, places, edges, height)
        paint_shaded(axes, places, (heat.max() - heat[drawn]) / max(np.ptp(heat), 1e-9), radius)

    def paint_labels(axes: Axes) -> None:
        radius = _paint_edges(axes, places, edges, height)
        paint_labelled(axes, places, [structure.labels[vertex] for vertex in drawn], palette, radius)

    alt = f"A tree of {len(drawn)} dots, one a training object, joined by lines."
    panels = [
        Panel(
            draw("space-heat", f"{alt} Colours: vertex heat.", height, paint_heat, frame=False),
            "Vertex heat, scaled and inverted",
        )
    ]
    labelled = any(label is not None for label in structure.labels)
    if labelled:
        picture = draw("space-labels", f"{alt} Colours: labels.", height, paint_labels, frame=False)
        panels.append(Panel(picture, "Labels, which learning did not see"))
    return Figure(
        key="space",
        title="The topological space: what resembles what",
        caption="Each dot is an object that the model learned from, a line joins two that look alike to it, and "
        "heat is how near a dot is to the middle of the tree"
        + ("; branches of one colour are objects that look alike and have the same name." if labelled else "."),
        panels=tuple(panels),
        legend=legend_of((structure.labels[vertex] for vertex in drawn), palette) if labelled else (),
        scale=("0: the outermost tip", "1: the middle"),
        paper="minimum spanning tree of Sec. Topological Space Generation",
        left_out=f"The {len(heat) - len(drawn)} outermost dots of {len(heat)} are not drawn."
        if len(drawn) < len(heat)
        else "",
    )


def _paint_edges(axes: Axes, places: NDArray[np.float64], edges: NDArray[np.int64], height: float) -> float:
    """Draws the edges; returns the radius that vertices should have."""
    scale = fit(axes, places, WIDTH, height)
    paint_alike(axes, lines(places, edges), "edges", PALE, 1)
    return radius_for(places, edges, scale)
