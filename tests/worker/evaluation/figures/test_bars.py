"""Figures beside those of others: as bars, as tables, and in words."""

from __future__ import annotations

import re

import pytest

from tests.worker.evaluation.figures.reports import bare_report, baseline, four, grouping, structure, whole_report
from worker.evaluation.figures.bars import Bar, bar_picture
from worker.evaluation.figures.baselines import MODEL, baseline_figure, label_table, other_figure
from worker.evaluation.figures.grouping import CONCEPTS, grouping_figure
from worker.evaluation.figures.robustness import robustness_figure
from worker.evaluation.figures.transfer import transfer_figure
from worker.evaluation.headline import headlines, summary
from worker.evaluation.report import Report


def beside(**figures: tuple[float, float, float, float]) -> Report:
    """A report whose own figures are 0.8, 0.7, 0.6, 0.5, beside baselines."""
    bare = bare_report()
    return bare.model_copy(
        update={"baselines": {name: baseline(four(*of), bare.figures) for name, of in figures.items()}}
    )


def test_a_bar_s_length_is_its_value() -> None:
    picture = bar_picture("bars", [Bar("one", 0.4), Bar("two", 0.8, own=True)])
    widths = []
    for found in re.finditer(r'<path d="M ([\d.]+) [\d.]+ \s*L ([\d.]+) [\d.]+ \s*L', picture):
        widths.append(float(found[2]) - float(found[1]))
    short, long = sorted(width for width in widths if 20 < width < 340)[-2:]
    assert long == pytest.approx(2 * short, rel=0.01)
    assert all(word in picture for word in (">one<", ">two<", ">0.40<", ">0.80<"))


def test_bars_below_zero_are_drawn() -> None:
    assert ">-0.30<" in bar_picture("bars", [Bar("one", -0.3), Bar("two", 0.8)]).replace("−", "-")


def test_every_way_of_describing_has_a_bar_in_each_of_the_four_figures() -> None:
    figure = baseline_figure(whole_report())
    assert len(figure.panels) == 4
    for panel in figure.panels:
        assert all(f">{name}<" in panel.picture for name in (MODEL, "mean FPFH", "ESF"))
    numbers, ahead = figure.tables
    assert [row[0] for row in numbers.rows] == [MODEL, "mean FPFH", "ESF"]
    assert ahead.rows[0][1] == "−0.100 (−0.150 to −0.050)"


def test_the_error_is_what_recall_leaves() -> None:
    assert {row[-1] for row in label_table(bare_report()).rows} == {"30.0 %"}


def test_the_best_baseline_is_told_for_each_figure() -> None:
    knn, svm, within, assigned = headlines(beside(first=(0.9, 0.1, 0.1, 0.5), second=(0.1, 0.2, 0.3, 0.1)))
    assert knn.verdict.startswith("0.10 behind the best baseline, first: 0.90")
    assert svm.verdict.startswith("0.50 ahead of the best baseline, second: 0.20")
    assert within.verdict == "0.30 ahead of the best baseline, second: 0.30"
    assert assigned.verdict == "level with the best baseline, first: 0.50"


@pytest.mark.parametrize(("rival", "said"), [(0.78, "may be chance"), (0.6, "beyond chance"), (0.95, "beyond chance")])
def test_a_lead_is_only_sure_where_its_interval_excludes_none(rival: float, said: str) -> None:
    assert said in headlines(beside(first=(rival, 0.1, 0.1, 0.1)))[0].verdict


def test_the_summary_counts_wins_and_losses() -> None:
    report = beside(first=(0.9, 0.1, 0.1, 0.5), second=(0.1, 0.2, 0.3, 0.1))
    assert "better on 2, level on 1, worse on 1 of the four figures" in summary(report)
    assert "No ready-made description" in summary(bare_report())


def test_groupings_are_compared_with_their_rivals() -> None:
    of = grouping(structure(60))
    figure = grouping_figure(of)
    assert figure is not None
    assert [row[0] for row in figure.tables[0].rows] == [CONCEPTS, "k-means, mean FPFH"]
    assert grouping_figure(of.model_copy(update={"figures": None})) is None


def test_transfer_other_sets_and_robustness_show_all_that_they_have() -> None:
    report = whole_report()
    assert report.transfer is not None
    assert report.robustness is not None
    transfer = transfer_figure(report.transfer).panels[0].picture
    assert all(f">{name}<" in transfer for name in ("motif prototypes", "nearest: responses"))
    assert len(other_figure(report.others[0], 0).panels) == 2
    curve = robustness_figure(report.robustness).panels[0]
    assert curve.heading == "scaled"
    assert curve.picture.count(">90%<") == 3
    assert all(f">{strength}<" in curve.picture for strength in ("0.3", "1", "3"))
