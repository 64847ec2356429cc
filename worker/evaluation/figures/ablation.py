"""What the motif levels pay: the model with parts of its hierarchies taken away."""

from __future__ import annotations

from worker.evaluation.figures.bars import Bar, bar_picture
from worker.evaluation.figures.baselines import MODEL, RECALLS, lead
from worker.evaluation.figures.figure import Figure, Panel, Table
from worker.evaluation.headline import NAMES
from worker.evaluation.report import Intervals, Report


def ablation_figure(report: Report) -> Figure:
    """The model beside what is left of it when some motif levels are taken away; at least one arm."""
    sets = [(report.data.labels, report.intervals)]
    sets += [(each.data.labels, each.model.intervals) for each in report.others]
    panels = tuple(Panel(bar_picture(f"ablation-{name}", _bars(report, name)), NAMES[name]) for name in RECALLS)
    return Figure(
        key="ablation",
        title="What each motif level pays",
        caption="Each bar is how well labels are told when the model is learnt anew from some motif levels alone: "
        "single segments, unions of several, whole objects; violet is the model as it is, 1 is best, and thin lines "
        "are 95 % intervals. What weighs nothing in the model weighs as much as the rest in these.",
        panels=panels,
        tables=tuple(_table(report, place, *each) for place, each in enumerate(sets)),
        paper="Sec. Hierarchical Object Decomposition and Representation",
    )


def _bars(report: Report, name: str) -> list[Bar]:
    every = {MODEL: report.intervals} if report.intervals else {}
    every |= {each.name: each.sets[0].intervals for each in report.ablation}
    found = {arm: getattr(intervals, name) for arm, intervals in every.items()}
    return [Bar(arm, each.value, each.low, each.high, own=arm == MODEL) for arm, each in found.items()]


def _table(report: Report, place: int, name: str, whole: Intervals | None) -> Table:
    rows = [(MODEL, "", "", *(f"{getattr(whole, kind).value:.3f}" for kind in RECALLS), "", "")] if whole else []
    for arm in report.ablation:
        found = arm.sets[place]
        values = (f"{getattr(found.intervals, kind).value:.3f}" for kind in RECALLS)
        leads = (lead(getattr(found.ahead, kind)) for kind in RECALLS)
        rows.append((arm.name, str(arm.vertices), str(arm.concepts), *values, *leads))
    names = [NAMES[kind] for kind in RECALLS]
    headings = ("what is left", "vertices", "concepts", *names, *(f"lead of the model, {each}" for each in names))
    return Table(headings, tuple(rows), f"On {name}")
