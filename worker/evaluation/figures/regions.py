"""The map CR^2 with its regions, and the two matrices of instances and regions.

Sec. Generalization to Other Real-World Datasets.
"""

from __future__ import annotations

from collections import Counter

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from worker.evaluation.figures.drawing import WIDTH, draw
from worker.evaluation.figures.figure import Figure, Panel, Table, legend_of
from worker.evaluation.figures.graphs import paint_labelled
from worker.evaluation.figures.palette import Palette
from worker.evaluation.report import Figures, Matrices, RegionGrid, ResponseMap

SIDE = float(WIDTH)  # of the map, which is square, CSS pixels
MOST = 3000  # clouds that are drawn
OUTLINE = "#ffffff"  # of a cloud, by day and night, so that it can be seen on ground of its own colour
STRONGEST = 0.7  # opacity of a cell whose neighbours all agree, less than all for the same reason


def map_figure(response_map: ResponseMap, palette: Palette) -> Figure:
    """The judged clouds in the plane, on regions coloured by the label of most of the nearest clouds."""
    every = max(1, -(-len(response_map.places) // MOST))
    drawn = response_map.places[::every]
    regions = response_map.regions
    points = np.array([(place.x, place.y) for place in drawn])
    labels = [place.label for place in drawn]

    def paint(axes: Axes) -> None:
        radius = float(np.clip(0.12 * SIDE / np.sqrt(len(drawn)), 1.5, 4.0))
        (left, bottom), (right, top) = regions.low, regions.high
        axes.imshow(
            _ground(regions, palette),
            extent=(left, right, bottom, top),
            origin="lower",
            aspect="auto",
            interpolation="none",
        )
        paint_labelled(axes, points, labels, palette, radius, OUTLINE)
        room = 0.03 * np.array([right - left, top - bottom])
        axes.set_xlim(left - room[0], right + room[0])
        axes.set_ylim(bottom - room[1], top + room[1])

    alt = f"A map of {len(drawn)} clouds: {_counted(labels)}; the ground has the colour of the nearest clouds' label."
    left_out = len(response_map.places) - len(drawn)
    return Figure(
        key="map",
        title="The map CR²: clouds that the model finds alike lie close together",
        caption="Each dot is a judged cloud, placed by the model's responses alone and coloured by its label; "
        f"the ground has the colour of most of the {regions.neighbours} nearest clouds, the stronger the more of them "
        "agree, so that labels which the concepts tell apart form areas of one strong colour.",
        panels=(Panel(draw("map", alt, SIDE, paint, frame=False)),),
        legend=legend_of(labels, palette),
        paper="CR² of Sec. Generalization to Other Real-World Datasets",
        left_out=f"Every {every}th of {len(response_map.places)} clouds is drawn." if left_out else "",
        columns=1,
    )


def matrix_figure(matrices: Matrices, figures: Figures) -> Figure:
    """Both matrices, whose diagonals' means are `within` and `assigned`."""
    return Figure(
        key="matrices",
        title="Regions and labels: how mixed the map is",
        caption="The stronger the diagonal, from top left to bottom right, the better regions go with labels; "
        "a strong field beside it says which two labels are taken for one another. Means over several maps.",
        tables=(
            _matrix(
                f"Clouds within a region: mean of the diagonal {figures.within:.2f}",
                "region of ↓ holds →",
                matrices.labels,
                matrices.within,
            ),
            _matrix(
                f"Clouds assigned to regions: mean of the diagonal {figures.assigned:.2f}",
                "clouds of ↓ lie in the region of →",
                matrices.labels,
                matrices.assigned,
            ),
        ),
        paper="both matrices of Sec. Generalization to Other Real-World Datasets",
    )


def _matrix(heading: str, corner: str, labels: list[str], values: list[list[float]]) -> Table:
    return Table(
        headings=(corner, *labels),
        rows=tuple((label, *(f"{value:.2f}" for value in row)) for label, row in zip(labels, values, strict=True)),
        heading=heading,
        shades=tuple(tuple(row) for row in values),
    )


def _ground(regions: RegionGrid, palette: Palette) -> NDArray[np.float64]:
    """(rows, columns, 4): the colour of each cell's label, as opaque as its neighbours agree."""
    colours = np.array([to_rgb(palette.mark(label).colour) for label in regions.labels])
    cells = np.array(regions.cells, np.int64)
    return np.concatenate([colours[cells], STRONGEST * np.array(regions.opacity)[:, :, None]], axis=2)


def _counted(labels: list[str]) -> str:
    return ", ".join(f"{count} {label}" for label, count in Counter(labels).most_common())
