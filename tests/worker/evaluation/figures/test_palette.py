"""One label, one colour."""

from __future__ import annotations

from tests.worker.evaluation.figures.reports import bare_report, structure, whole_report
from worker.evaluation.figures.figure import legend_of
from worker.evaluation.figures.palette import ABSENT, COLOURS, Palette, palette_of
from worker.evaluation.labels import OTHER


def test_labels_that_are_judged_have_colours_before_all_others() -> None:
    report = bare_report(("can", "zebra")).model_copy(update={"structure": structure(9, ("ant", "can", None))})
    assert palette_of(report).labels == ("can", "zebra", "ant")


def test_what_is_no_category_has_no_colour_of_its_own() -> None:
    palette = palette_of(bare_report())
    assert OTHER not in palette.labels
    assert palette.mark(OTHER).colour == palette.mark(None).colour == ABSENT


def test_labels_can_be_told_apart_beyond_the_number_of_colours() -> None:
    palette = Palette(tuple(f"label {number}" for number in range(2 * len(COLOURS))))
    marks = [palette.mark(label) for label in palette.labels]
    assert len({(mark.colour, mark.marker) for mark in marks}) == len(marks)
    assert len({(mark.colour, mark.hatch) for mark in marks}) == len(marks)


def test_a_legend_names_what_occurs_and_nothing_else() -> None:
    palette = Palette(("box", "can", "plate"))
    entries = legend_of(["plate", None, "box", "plate", OTHER], palette)
    assert [entry.label for entry in entries] == ["box", "plate", OTHER, "no label"]
    assert [entry.colour for entry in entries[:2]] == [palette.mark("box").colour, palette.mark("plate").colour]


def test_one_report_gives_one_palette() -> None:
    assert palette_of(whole_report()) == palette_of(whole_report())
