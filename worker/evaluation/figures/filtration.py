"""The filtration over time: the barcode of H_0, and how many annexations each time saw. Sec. Topological Filtration."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from worker.evaluation.figures.drawing import draw
from worker.evaluation.figures.figure import Entry, Figure, Panel
from worker.evaluation.figures.palette import ACCENT, INK, PAGE_COLOURS, PALE
from worker.evaluation.report import Structure

HEIGHT = 260.0  # CSS pixels
SEPARATE = 90  # bars that can be told apart; more are drawn as blocks of those that end together
AFTER = 1.06  # where the bar that never ends leaves the picture


def filtration_figure(structure: Structure) -> Figure:
    """The barcode of H_0, and the annexations over time with epsilon_max."""
    deaths = np.sort(structure.time)
    size, chosen = len(deaths) + 1, structure.epsilon_max
    ended = int((deaths <= chosen).sum())
    alt = f"{size} bars from time 0 on, the shortest at the bottom; {ended} have ended by time {chosen:.2f}."
    barcode = draw("barcode", alt, HEIGHT, lambda axes: _paint_bars(axes, deaths, chosen))
    times, counts = np.unique(deaths, return_counts=True)
    alt = f"Columns: annexations over time, most of them, {counts.max()}, at time {times[counts.argmax()]:.2f}."
    annexations = draw("annexations", alt, HEIGHT, lambda axes: _paint_counts(axes, times, counts, chosen))
    return Figure(
        key="filtration",
        title="The barcode and the annexations: when concepts are taken",
        caption=f"Each of the {size} bars is an object's group, which begins at time 0 and ends when a larger group "
        f"swallows it; the columns count how many end at each time. Concepts are taken at ε max = "
        f"{chosen:.2f} (dashed): earlier, groups are many and specific, later few and generic.",
        panels=(Panel(barcode, "Barcode of H₀"), Panel(annexations, "Annexations at each time")),
        legend=(
            Entry("ended by ε max", PAGE_COLOURS[PALE], "s"),
            Entry("lives on after it", PAGE_COLOURS[ACCENT], "s"),
        ),
        paper="barcode and annexation of Sec. Topological Filtration (experiments)",
    )


def _paint_bars(axes: Axes, deaths: NDArray[np.float64], chosen: float) -> None:
    place = np.arange(len(deaths) + 1)
    ends = np.append(deaths, AFTER)
    if len(place) <= SEPARATE:
        late = ends > chosen
        width = min(3.0, 0.62 * HEIGHT / len(place))
        for some, colour in ((~late, PALE), (late, ACCENT)):
            axes.hlines(place[some], 0, ends[some], colors=colour, linewidth=width)
    else:
        death, count = np.unique(ends, return_counts=True)
        colours = [PALE if end <= chosen else ACCENT for end in death]
        axes.barh(count.cumsum() - count, death, count, align="edge", color=colours, edgecolor=colours, linewidth=0.3)
    axes.set_ylim(-1, len(place) + 1)
    axes.set_ylabel("objects, by the time they end")
    axes.yaxis.set_major_locator(MaxNLocator(5, integer=True))
    axes.grid(axis="y", visible=False)
    _mark(axes, chosen)


def _paint_counts(axes: Axes, times: NDArray[np.float64], counts: NDArray[np.int64], chosen: float) -> None:
    step = float(np.quantile(np.diff(times), 0.25)) if len(times) > 1 else 0.05  # the last step may be a short one
    axes.bar(times, counts, width=0.85 * step, color=[ACCENT if time > chosen else PALE for time in times])
    axes.set_ylabel("groups annexed")
    axes.yaxis.set_major_locator(MaxNLocator(5, integer=True))
    axes.grid(axis="x", visible=False)
    axes.margins(y=0.15)
    _mark(axes, chosen)


def _mark(axes: Axes, chosen: float) -> None:
    """The time axis with epsilon_max."""
    axes.axvline(chosen, color=INK, linewidth=1, linestyle="--")
    axes.set_title(f"ε max = {chosen:.2f}", x=min(max(chosen / AFTER, 0.14), 0.86), fontsize=12, pad=4)
    axes.set_xlim(0, AFTER)
    axes.set_xticks(np.linspace(0, 1, 6))
    axes.set_xlabel("filtration time")
