"""The model's figures beside those of the baselines."""

from __future__ import annotations

from worker.evaluation.figures.bars import Bar, bar_picture
from worker.evaluation.figures.figure import Figure, Panel, Table
from worker.evaluation.headline import NAMES, signed
from worker.evaluation.report import Figures, Interval, Intervals, OtherSet, Report

RECALLS = ("knn", "svm")
MODEL = "this model"


def baseline_figure(report: Report) -> Figure:
    """The four figures of the model and of each baseline; a table has the same in numbers, and label by label."""
    bars = {name: [_bar(MODEL, report.figures, report.intervals, name, own=True)] for name in NAMES}
    for rival, baseline in report.baselines.items():
        for name in NAMES:
            bars[name].append(_bar(rival, baseline.figures, baseline.intervals, name))
    panels = [Panel(bar_picture(f"baseline-{name}", bars[name]), heading) for name, heading in NAMES.items()]
    return Figure(
        key="baselines",
        title="Beside what could be had without this model",
        caption="Each bar is how well one way of describing a cloud tells the labels apart, 1 being best; violet is "
        "this model, grey are the ready-made descriptions. A thin line spans where the figure would lie in 95 of "
        "100 other draws of such clouds: bars whose lines overlap much are hardly different.",
        panels=tuple(panels),
        tables=(_figure_table(report), *([_ahead_table(report)] if report.baselines else [])),
    )


def other_figure(other: OtherSet, place: int) -> Figure:
    """Another set of clouds, judged by the first; `place` tells it from further ones."""
    intervals = {MODEL: other.model.intervals} | {name: rival.intervals for name, rival in other.baselines.items()}
    panels = []
    for name in RECALLS:
        bars = [_of(rival, getattr(each, name), own=rival == MODEL) for rival, each in intervals.items()]
        panels.append(Panel(bar_picture(f"other-{place}-{name}", bars), NAMES[name]))
    rows = [
        (label, str(other.data.categories.get(label, 0)), *(f"{recalls[name]:.3f}" for name in RECALLS))
        for label, recalls in sorted(other.model.by_label.items())
    ]
    return Figure(
        key=f"other-{place}",
        title=f"Another set: {other.data.labels}",
        caption=f"{other.data.judged} clouds of another set, told apart by what is known of the first; violet is this "
        "model, grey are the ready-made descriptions, 1 is best, and thin lines are 95 % intervals.",
        panels=tuple(panels),
        tables=(Table(("label", "clouds", *(NAMES[name] for name in RECALLS)), tuple(rows), "Label by label"),),
    )


def label_table(report: Report) -> Table:
    """The figures of each label, and the error that the paper's Table 1 has."""
    rows = [
        (label, str(report.data.categories[label]), *_numbers(figures), f"{100 * (1 - figures.svm):.1f} %")
        for label, figures in report.by_label.items()
    ]
    headings = ("label", "clouds", *NAMES.values(), "error of the machine")
    return Table(headings, tuple(rows), "This model, label by label")


def source_table(report: Report) -> Table:
    """The figures of each source's clouds."""
    rows = [
        (source, str(figures.clouds), f"{figures.knn:.3f}", f"{figures.svm:.3f}")
        for source, figures in report.by_source.items()
    ]
    return Table(("source", "clouds", *(NAMES[name] for name in RECALLS)), tuple(rows), "Source by source")


def _figure_table(report: Report) -> Table:
    every = [(MODEL, report.model.responses, report.figures)]
    every += [(name, baseline.dimensions, baseline.figures) for name, baseline in report.baselines.items()]
    rows = [(name, str(size), *_numbers(figures)) for name, size, figures in every]
    return Table(("vectors", "length", *NAMES.values()), tuple(rows), "The four figures, means over labels")


def _ahead_table(report: Report) -> Table:
    rows = [
        (name, *(lead(getattr(baseline.ahead, figure)) for figure in RECALLS))
        for name, baseline in report.baselines.items()
    ]
    heading = "How far this model is ahead (+) or behind (−), with 95 % intervals over the same clouds"
    return Table(("of", *(NAMES[name] for name in RECALLS)), tuple(rows), heading)


def _bar(rival: str, figures: Figures, intervals: Intervals | None, name: str, own: bool = False) -> Bar:
    interval = getattr(intervals, name, None)
    low, high = (interval.low, interval.high) if interval else (None, None)
    return Bar(rival, getattr(figures, name), low, high, own)


def _of(rival: str, interval: Interval, own: bool) -> Bar:
    return Bar(rival, interval.value, interval.low, interval.high, own)


def _numbers(figures: Figures) -> tuple[str, ...]:
    return tuple(f"{value:.3f}" for value in figures.model_dump().values())


def lead(interval: Interval) -> str:
    """A difference and its interval, in words."""
    return f"{signed(interval.value, 3)} ({signed(interval.low, 3)} to {signed(interval.high, 3)})"
