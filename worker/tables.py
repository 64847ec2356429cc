"""Results of the worker as tables, for people at a terminal."""

from __future__ import annotations

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from worker.evaluation.report import Figures, Report


def show_report(report: Report) -> None:
    """Prints the figures of an evaluation, a row a label."""
    data, model = report.data, report.model
    title = (
        f"{model.name}:{model.version}, {model.concepts} concepts, judged by {data.judged} of {data.clouds} clouds of "
        f"{escape(data.labels)} (shares, 1 is best)"
    )
    table = Table(title=title, title_justify="left", title_style="bold")
    for heading in ("label", "clouds", *Figures.model_fields):
        table.add_column(heading, justify="left" if heading == "label" else "right")
    for label, figures in report.by_label.items():
        table.add_row(escape(label), str(data.categories[label]), *_shares(figures))
    table.add_section()
    table.add_row("mean", str(data.judged), *_shares(report.figures))
    table.add_section()
    for name, baseline in report.baselines.items():
        table.add_row(f"{escape(name)}, mean", str(data.judged), *_shares(baseline.figures))
    console = Console()
    console.print(table)
    for other in report.others:
        recalls = other.model.intervals
        console.print(
            f"{escape(other.data.labels)}, {other.data.judged} clouds judged by these: "
            f"knn {recalls.knn.value:.3f}, svm {recalls.svm.value:.3f}.",
            highlight=False,
        )
    if report.transfer:
        recall = report.transfer.recall
        console.print(
            f"Taught one instance a label: {recall.mean:.3f} ± {recall.deviation:.3f} of each label are found.",
            highlight=False,
        )
    if (grouping := report.grouping) is None:
        console.print("No prototype of the model is among these clouds: its concepts' purity cannot be told.")
    else:
        console.print(
            f"{len(grouping.concepts)} concepts, mean purity {grouping.purity:.2f}, {grouping.pure:.0%} of them pure, "
            f"covering {grouping.covered:.0%} of the {grouping.prototypes} labelled prototypes.",
            highlight=False,
        )


def _shares(figures: Figures) -> list[str]:
    return [f"{value:.3f}" for value in figures.model_dump().values()]
