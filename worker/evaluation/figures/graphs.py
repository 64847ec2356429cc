"""Vertices and edges on a picture without axes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.colors import to_rgba_array
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from numpy.typing import NDArray

from worker.evaluation.figures.drawing import WIDTH
from worker.evaluation.figures.palette import ACCENT, FAINTEST, INK, PAPER, Palette

LARGEST, SMALLEST = 4.5, 1.2  # radius of a vertex, CSS pixels
LOW, HIGH = 140.0, 720.0  # of a picture, CSS pixels
MARGIN = 8.0  # CSS pixels
DASHED = (0, (3, 2))  # of matplotlib: where the dashes begin, and lengths of dash and gap, line widths
MOST = 1500  # vertices that are drawn: more cannot be told apart, and would make the page slow


def height_for(places: NDArray[np.float64]) -> float:
    """Of a picture that is 360 wide and holds the places (N, 2) undistorted, CSS pixels."""
    across, up = np.ptp(places, axis=0)
    return float(np.clip(WIDTH * up / max(across, 1e-9), LOW, HIGH))


def fit(axes: Axes, places: NDArray[np.float64], width: float, height: float, margin: float = MARGIN) -> float:
    """Makes axes hold the places (N, 2) undistorted, in the middle; returns the pixels of a unit."""
    low, high = places.min(axis=0), places.max(axis=0)
    room = np.array([width, height]) - 2 * margin
    scale = float(np.min(room / np.maximum(high - low, 1e-9)))
    scale = min(scale, float(room.min()) / 2)  # two vertices shall not fill the picture
    half = np.array([width, height]) / scale / 2
    middle = (low + high) / 2
    axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axes.set_ylim(middle[1] - half[1], middle[1] + half[1])
    return scale


def radius_for(places: NDArray[np.float64], edges: NDArray[np.int64], scale: float) -> float:
    """Of vertices so that those of an ordinary edge do not touch, CSS pixels."""
    if not len(edges):
        return LARGEST
    length = np.linalg.norm(places[edges[:, 0]] - places[edges[:, 1]], axis=1)
    return float(np.clip(0.4 * np.median(length) * scale, SMALLEST, LARGEST))


def curves(places: NDArray[np.float64], edges: NDArray[np.int64]) -> list[Path]:
    """Edges (E, 2) of a tree drawn on rings about the origin, as curves that leave and meet the rings at right angles.

    Both ends' handles lie half way between the two rings.
    """
    ends = places[edges]  # (E, 2, 2)
    radius = np.linalg.norm(ends, axis=2, keepdims=True)
    middle = radius.mean(axis=1, keepdims=True)
    handles = np.where(radius > 0, ends * middle / np.maximum(radius, 1e-9), ends)
    codes = [Path.MOVETO, Path.CURVE4, Path.CURVE4, Path.CURVE4]
    return [Path([a, b, c, d], codes) for (a, d), (b, c) in zip(ends, handles, strict=True)]


def lines(places: NDArray[np.float64], edges: NDArray[np.int64]) -> list[Path]:
    """Edges (E, 2) as straight lines."""
    return [Path(ends, [Path.MOVETO, Path.LINETO]) for ends in places[edges]]


def paint_alike(axes: Axes, paths: Sequence[Path], key: str, colour: str, width: float, dashed: bool = False) -> None:
    """Draws edges that all look the same, as one path, which is short to write."""
    if paths:
        whole = Path.make_compound_path(*paths)
        style = DASHED if dashed else "-"
        axes.add_patch(
            PathPatch(whole, fill=False, gid=key, edgecolor=colour, linewidth=width, linestyle=style, clip_on=False)
        )


def paint_each(axes: Axes, paths: Sequence[Path], key: str, colour: str, widths: NDArray[np.float64]) -> None:
    """Draws edges, each of its own width."""
    axes.add_collection(
        PathCollection(paths, facecolors="none", gid=key, edgecolors=colour, linewidths=widths, clip_on=False, zorder=1)
    )


def paint_shaded(axes: Axes, places: NDArray[np.float64], shares: NDArray[np.float64], radius: float) -> None:
    """Draws vertices (N, 2), each the stronger the larger its share in [0, 1]."""
    area, (x, y) = (2 * radius) ** 2, places.T
    axes.scatter(x, y, s=area, c=PAPER, linewidths=0, clip_on=False, zorder=2)
    colours = to_rgba_array([ACCENT] * len(shares), FAINTEST + (1 - FAINTEST) * shares)
    axes.scatter(x, y, s=area, c=colours, edgecolors=INK, linewidths=0.12 * radius, clip_on=False, zorder=3)


def paint_labelled(
    axes: Axes,
    places: NDArray[np.float64],
    labels: Sequence[str | None],
    palette: Palette,
    radius: float,
    outline: str = INK,
) -> None:
    """Draws vertices (N, 2) in the colours and shapes of their labels."""
    every = np.array([palette.labels.index(label) if label in palette.labels else -1 for label in labels])
    x, y = places.T
    for place in np.unique(every):
        mark = palette.mark(palette.labels[place] if place >= 0 else None)
        area = (2 * radius) ** 2
        chosen = every == place
        axes.scatter(
            x[chosen],
            y[chosen],
            s=area,
            c=mark.colour,
            marker="o" if mark.marker == "." else mark.marker,
            edgecolors=outline,
            linewidths=(0.12 if outline == INK else 0.25) * radius,
            clip_on=False,
            zorder=2,
        )
