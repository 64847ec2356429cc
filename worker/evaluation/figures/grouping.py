"""Concepts as groups, beside clusterings of ready-made descriptions into as many groups."""

from __future__ import annotations

from worker.evaluation.figures.bars import Bar, bar_picture
from worker.evaluation.figures.figure import Figure, Panel, Table
from worker.evaluation.report import GroupFigures, Grouping

SHOWN = {
    "purity": "mean purity",
    "v_measure": "V-measure",
    "adjusted_rand": "adjusted Rand index",
    "covered": "covered",
}
CONCEPTS = "this model's concepts"


def grouping_figure(grouping: Grouping) -> Figure | None:
    """How well groups go with labels: concepts and rival clusterings; None where there is nothing to compare."""
    if grouping.figures is None:
        return None
    every = {CONCEPTS: grouping.figures}
    every |= {f"{rival.method}, {rival.vectors}": rival.figures for rival in grouping.rivals}
    panels = []
    for name, heading in SHOWN.items():
        bars = [Bar(who, getattr(figures, name), own=who == CONCEPTS) for who, figures in every.items()]
        panels.append(Panel(bar_picture(f"grouping-{name}", bars), heading))
    settings = [(f"{rival.method}, {rival.vectors}", rival.setting, str(rival.runs)) for rival in grouping.rivals]
    return Figure(
        key="grouping",
        title="Grouping: do groups found without labels go with labels?",
        caption=f"The {grouping.prototypes} labelled objects that the model learned from were grouped by its concepts "
        "(violet) and by two standard clusterings of ready-made descriptions (grey), into as many groups: longer bars "
        "mean that groups and labels agree more, 1 being best.",
        panels=tuple(panels),
        tables=(
            Table(
                (
                    "groups by",
                    "groups",
                    "covered",
                    "mean purity",
                    "pure",
                    "V-measure",
                    "adjusted Rand",
                    "V, covered",
                    "Rand, covered",
                ),
                tuple((who, *_numbers(figures)) for who, figures in every.items()),
                "The same in numbers; the last two over the objects that the concepts cover",
            ),
            *(
                [Table(("clustering", "setting", "runs"), tuple(settings), "How the clusterings were made")]
                if settings
                else []
            ),
        ),
        paper="Sec. Unsupervised Concept Selection: purity, Eq. 5",
    )


def _numbers(figures: GroupFigures) -> tuple[str, ...]:
    shares = (
        figures.covered,
        figures.purity,
        figures.pure,
        figures.v_measure,
        figures.adjusted_rand,
        figures.v_measure_covered,
        figures.adjusted_rand_covered,
    )
    return (str(figures.groups), *(f"{share:.3f}" for share in shares))
