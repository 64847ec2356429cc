"""The page for people: whole, self-contained, and harmless whatever the labels are."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from tests.learnt import learnt
from tests.worker.evaluation.figures.reports import (
    LABELS,
    Page,
    bare_report,
    baseline,
    grouping,
    structure,
    thumbnails,
    whole_report,
)
from worker.evaluation.page import render, write_page
from worker.evaluation.report import Report, SourceFigures

SIZE = 60
EVERY_FIGURE = (
    "baselines",
    "ablation",
    "map",
    "matrices",
    "space",
    "annexation",
    "filtration",
    "concepts",
    "ranked",
    "grouping",
    "transfer",
    "other-0",
    "robustness",
)
HOSTILE = "<script>alert('$x^2$')</script>\"><img src=x onerror=alert(1)> & {{ 7 * 7 }} \\1"


def rendered(report: Report, size: int = SIZE) -> str:
    return render(report, thumbnails(size), np.random.default_rng(1).random((size, 3)))


@pytest.fixture(scope="module")
def html() -> str:
    return rendered(whole_report(SIZE))


@pytest.fixture(scope="module")
def page(html: str) -> Page:
    return Page(html)


def test_a_whole_report_has_every_figure(page: Page) -> None:
    figures = [attributes.get("id") for tag, attributes in page.tags if tag == "figure"]
    assert sorted(filter(None, figures)) == sorted(EVERY_FIGURE)


def test_one_report_gives_one_page(html: str) -> None:
    assert rendered(whole_report(SIZE)) == html


def test_a_page_needs_nothing_but_itself(html: str, page: Page) -> None:
    assert all(value.startswith(("#", "data:image/png;base64,")) for value in page.values("href") + page.values("src"))
    assert all(value.startswith(("#", "data:image/png;base64,")) for value in page.values("xlink:href"))
    assert "script" not in {tag for tag, _ in page.tags}
    assert not re.search(r"@import|url\((?!#)", html)


def test_a_page_is_closed_where_it_was_opened(page: Page) -> None:
    assert page.open_tags == []
    assert page.wrongly_closed == []


def test_every_name_is_unique_and_every_link_leads_somewhere(html: str, page: Page) -> None:
    names = Counter(page.values("id"))
    assert max(names.values()) == 1
    links = {value[1:] for value in page.values("href") + page.values("xlink:href") if value.startswith("#")}
    links |= set(re.findall(r"url\(#([^)]*)\)", html)) | set(page.values("aria-labelledby"))
    assert links <= set(names)


def test_every_picture_is_told_in_words(page: Page) -> None:
    for tag, attributes in page.tags:
        if tag == "img":
            assert attributes.get("alt")
        if tag == "svg":
            assert attributes.get("aria-hidden") == "true" or (
                attributes.get("role") == "img" and attributes.get("aria-label")
            )


def test_every_figure_says_what_it_shows(html: str) -> None:
    for key in EVERY_FIGURE:
        after = html.split(f'<figure id="{key}"')[1]
        caption = re.search(r"<figcaption>(.*?)</figcaption>", after, re.DOTALL)
        assert caption is not None
        assert len(caption[1]) > 60


def test_what_can_be_scrolled_can_be_reached_by_keyboard(page: Page) -> None:
    for tag, attributes in page.tags:
        if "table" in (attributes.get("class") or "").split() and tag == "div":
            assert attributes.get("tabindex") == "0"
            assert attributes.get("aria-label")


def test_a_label_has_one_colour_in_all_legends(html: str) -> None:
    shown = re.findall(r'<g fill="(#[0-9a-f]{6})".*?</svg>\s*(\w+)', html)
    assert {label for _, label in shown} == set(LABELS)
    assert len(set(shown)) == len(LABELS)


def test_what_comes_from_files_is_text_and_never_markup() -> None:
    report = whole_report(SIZE, (HOSTILE, "can", "plate"))
    bare = report.figures
    of = structure(SIZE, (HOSTILE, "can", "plate")).model_copy(update={"keys": [HOSTILE] * SIZE})
    report = report.model_copy(
        update={
            "command": HOSTILE,
            "structure": of,
            "by_source": {HOSTILE: SourceFigures(clouds=3, knn=0.5, svm=0.5)},
            "baselines": {HOSTILE: baseline(bare, bare, HOSTILE)},
            "protocol": {HOSTILE: HOSTILE},
            "data": report.data.model_copy(update={"labels": HOSTILE, "unanswered": {HOSTILE: HOSTILE}}),
        }
    )
    page = Page(rendered(report))
    assert {tag for tag, _ in page.tags} & {"script"} == set()
    assert not [attributes for _, attributes in page.tags if "onerror" in attributes]
    assert HOSTILE in page.text
    assert page.open_tags == page.wrongly_closed == []


def test_a_page_forbids_itself_whatever_is_not_its_own(page: Page) -> None:
    policy = next(attributes for tag, attributes in page.tags if tag == "meta" and "http-equiv" in attributes)
    assert policy["http-equiv"] == "Content-Security-Policy"
    assert (policy["content"] or "").startswith("default-src 'none'")


def test_a_bare_report_has_a_page_without_what_it_lacks() -> None:
    page = Page(rendered(bare_report()))
    figures = {attributes.get("id") for tag, attributes in page.tags if tag == "figure"}
    assert figures == {"baselines", "matrices"}
    assert page.open_tags == []


def test_a_model_of_unlabelled_clouds_has_its_figures_without_labels() -> None:
    report = bare_report().model_copy(update={"structure": structure(SIZE, (None,))})
    page = Page(rendered(report))
    figures = {attributes.get("id") for tag, attributes in page.tags if tag == "figure"}
    assert figures == {"baselines", "matrices", "space", "annexation", "filtration", "concepts", "ranked"}


@pytest.mark.slow
def test_a_page_of_ten_thousand_objects_can_be_opened() -> None:
    size = 10_000
    of = structure(size)
    report = whole_report(SIZE).model_copy(update={"structure": of, "grouping": grouping(of)})
    html = rendered(report, size)
    assert len(html.encode()) < 5e6
    for said in ("outermost dots of 10000 are not drawn", "A card draws at most", "and [0-9]+ more"):
        assert re.search(said, html)


def test_a_learnt_model_has_its_page_in_a_folder(tmp_path: Path) -> None:
    model = learnt()
    report = bare_report().model_copy(update={"structure": structure(len(model.prototypes.cloud_keys), (None,))})
    file = write_page(report, model, tmp_path / "made" / "for it")
    assert [path.name for path in file.parent.iterdir()] == ["report.html"]
    assert file.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
