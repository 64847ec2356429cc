"""Whether the best concept stays when clouds are disturbed."""

from __future__ import annotations

from functools import partial

from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, NullLocator, PercentFormatter

from worker.evaluation.figures.drawing import draw
from worker.evaluation.figures.figure import Figure, Panel, Table
from worker.evaluation.figures.palette import ACCENT
from worker.evaluation.report import Curve, Robustness

HEIGHT = 220.0  # CSS pixels
WIDE = 4.0  # strengths that span more than this factor stand on a logarithmic axis


def robustness_figure(robustness: Robustness) -> Figure:
    """A curve for each disturbance: the share of clouds that keep their best concept."""
    panels = [
        Panel(draw(f"robustness-{place}", _alt(curve), HEIGHT, partial(_paint, curve)), curve.name, curve.description)
        for place, curve in enumerate(robustness.curves)
    ]
    return Figure(
        key="robustness",
        title="Robustness: does the same object keep its concept?",
        caption=f"{robustness.clouds} clouds were disturbed on purpose, and each curve shows how many of them are "
        "still put first into the concept that they had undisturbed: the longer a curve stays high, the less that "
        f"disturbance matters. Undisturbed, {robustness.in_use} concepts are in use.",
        panels=tuple(panels),
        tables=tuple(_table(curve) for curve in robustness.curves),
    )


def _paint(curve: Curve, axes: Axes) -> None:
    strengths = [at.strength for at in curve.strengths]
    axes.plot(strengths, [at.kept for at in curve.strengths], color=ACCENT, marker="o", markersize=5, linewidth=2)
    for at in curve.strengths:
        below = at.kept > 0.9
        axes.annotate(
            f"{at.kept:.0%}",
            (at.strength, at.kept),
            xytext=(0, -7 if below else 7),
            textcoords="offset points",
            ha="center",
            va="top" if below else "bottom",
            fontsize=10,
        )
    if min(strengths) > 0 and max(strengths) > WIDE * min(strengths):
        axes.set_xscale("log")
        axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xticks(strengths)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.set_xlabel(curve.unit or "factor")
    axes.set_ylabel("keep their concept")
    axes.set_ylim(0, 1.04)
    axes.margins(x=0.08)
    axes.yaxis.set_major_formatter(PercentFormatter(1))


def _alt(curve: Curve) -> str:
    return f"{curve.name}: " + ", ".join(f"{at.kept:.0%} at {at.strength:g}" for at in curve.strengths)


def _table(curve: Curve) -> Table:
    return Table(
        headings=(curve.unit or "factor", "keep it", "concepts in use", "refused"),
        rows=tuple((f"{at.strength:g}", f"{at.kept:.0%}", str(at.in_use), str(at.refused)) for at in curve.strengths),
        heading=curve.name,
    )
