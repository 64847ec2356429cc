"""Values of at most 1 as bars below one another, with their intervals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes

from worker.evaluation.figures.drawing import draw, shortened
from worker.evaluation.figures.palette import ABSENT, ACCENT, INK

ROW, BELOW = 42.0, 26.0  # of a bar with its name above, and of what is below all bars, CSS pixels
LONGEST = 50  # characters of a name above a bar


class Bar(NamedTuple):
    """A value of at most 1, the ends of its interval where it has one, and whether it is the model's."""

    name: str
    value: float
    low: float | None = None
    high: float | None = None
    own: bool = False


def bar_picture(key: str, bars: Sequence[Bar]) -> Markup:
    """Bars below one another, each with its name and value; at least one."""
    alt = "; ".join(f"{bar.name} {bar.value:.2f}" for bar in bars)
    return draw(key, alt, BELOW + ROW * len(bars), lambda axes: _paint(axes, bars))


def _paint(axes: Axes, bars: Sequence[Bar]) -> None:
    least = min(0.0, *(bar.value for bar in bars), *(bar.low or 0.0 for bar in bars))
    for place, bar in enumerate(bars):
        weight = "bold" if bar.own else "normal"
        axes.barh(place, bar.value, 0.36, color=ACCENT if bar.own else ABSENT)
        axes.text(least, place - 0.24, shortened(bar.name, LONGEST), verticalalignment="bottom", fontweight=weight)
        if bar.low is not None and bar.high is not None:
            axes.plot([bar.low, bar.high], [place, place], color=INK, linewidth=1.2, marker="|", markersize=7)
        axes.annotate(
            f"{bar.value:.2f}",
            (max(bar.value, bar.high or 0.0, 0.0), place),
            xytext=(5, 0),
            textcoords="offset points",
            verticalalignment="center",
            fontweight=weight,
        )
    axes.set_xlim(least, 1.16)
    axes.set_ylim(len(bars) - 0.6, -0.75)
    axes.set_xticks(np.arange(np.ceil(5 * least), 6) / 5)
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    axes.axvline(0, color=INK, linewidth=0.8)
