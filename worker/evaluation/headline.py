"""The four figures in words, each beside the best of the baselines."""

from __future__ import annotations

from typing import NamedTuple

from worker.evaluation.report import Interval, Report

NAMES = {
    "knn": "nearest neighbour",
    "svm": "support vector machine",
    "within": "within regions",
    "assigned": "assigned to regions",
}
MEANINGS = {
    "knn": "of the clouds have the same label as the cloud that the model finds most alike",
    "svm": "of the clouds are labelled right by a classifier that was taught with other objects' responses",
    "within": "of what lies in a region of the map bears that region's label",
    "assigned": "of a label's clouds lie in the regions of that label",
}
LEVEL = 0.005  # figures that differ by less are the same when rounded to hundredths


class Headline(NamedTuple):
    """One figure: its short and its plain name, its value and meaning, and how it stands to the best baseline."""

    name: str
    title: str
    value: float
    meaning: str
    verdict: str


def headlines(report: Report) -> tuple[Headline, ...]:
    """The four figures with their verdicts."""
    return tuple(
        Headline(name, NAMES[name], getattr(report.figures, name), meaning, _verdict(report, name))
        for name, meaning in MEANINGS.items()
    )


def summary(report: Report) -> str:
    """The whole in two sentences."""
    data = report.data
    judged = (
        f"{data.judged} clouds of {len(data.categories)} labels were put to the model {report.model.name}:"
        f"{report.model.version}, which answers with {report.model.responses} concepts."
    )
    if not report.baselines:
        return f"{judged} No ready-made description was computed beside it."
    ahead = [name for name in MEANINGS if getattr(report.figures, name) >= _best(report, name)[1] + LEVEL]
    behind = [name for name in MEANINGS if getattr(report.figures, name) <= _best(report, name)[1] - LEVEL]
    level = len(MEANINGS) - len(ahead) - len(behind)
    parts = [f"better on {len(ahead)}", *([f"level on {level}"] if level else []), f"worse on {len(behind)}"]
    return f"{judged} Beside the best of {_count(report)}, it is {', '.join(parts)} of the four figures."


def _verdict(report: Report, name: str) -> str:
    if not report.baselines:
        return "no baseline was computed"
    rival, value = _best(report, name)
    lead = getattr(report.figures, name) - value
    if abs(lead) < LEVEL:
        words = f"level with the best baseline, {rival}: {value:.2f}"
    else:
        words = f"{abs(lead):.2f} {'ahead of' if lead > 0 else 'behind'} the best baseline, {rival}: {value:.2f}"
    interval: Interval | None = getattr(report.baselines[rival].ahead, name, None)
    if interval is None:
        return words
    sure = "beyond chance" if interval.low > 0 or interval.high < 0 else "which may be chance"
    return f"{words} ({sure}; 95 % interval of the lead {signed(interval.low, 3)} to {signed(interval.high, 3)})"


def signed(value: float, digits: int = 2) -> str:
    """A difference with its sign, the minus as wide as the plus."""
    return f"{value:+.{digits}f}".replace("-", "−")


def _best(report: Report, name: str) -> tuple[str, float]:
    rival = max(report.baselines, key=lambda baseline: getattr(report.baselines[baseline].figures, name))
    return rival, getattr(report.baselines[rival].figures, name)


def _count(report: Report) -> str:
    number = len(report.baselines)
    return f"{number} ready-made descriptions" if number > 1 else "one ready-made description"
