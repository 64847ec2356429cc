"""Train in a real browser: jobs of a real worker followed, versions compared, promoted, taken back."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from service.datasets import Datasets
from tests.acceptance.browsing import DESKTOP, Visit
from tests.acceptance.jobs_place import Place, free_port
from tests.acceptance.page.train.using import JOB, job, learn, serving, state, told
from tests.acceptance.page.visiting import Visiting

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = pytest.mark.slow


@pytest.mark.usefixtures("worker")
def test_a_job_is_followed_to_its_end_judged_and_its_version_compared_promoted_and_taken_back(
    visit: Visiting, host: str
) -> None:
    visited = visit("#/train")
    page = visited.page
    learn(page, "toys", Follows="toys", Judge_it_by="shelf", Let_it_serve="never")
    page.locator(".stages[role=progressbar]").wait_for(timeout=JOB)
    assert int(page.locator(".stages").get_attribute("aria-valuenow") or "") < 100
    state(page, "done")
    name = page.url.partition("job=")[2].partition("&")[0]
    made = told(host, f"jobs/{name}")["result"]
    assert (made["model"], made["version"], made["parent"], made["promoted"]) == ("toys", 2, "toys:1", False)
    job(page).get_by_text("toys:2 was learnt from 14 clouds and was not promoted.").wait_for()
    figures = job(page).locator(".figures tr td.number").all_inner_texts()
    assert figures == [f"{figure:.3f}" for figure in made["metrics"].values()]
    job(page).get_by_text("Log", exact=True).click()
    lines = [line["line"] for line in told(host, f"jobs/{name}/logs")["lines"]]
    shown = job(page).locator(".log").inner_text().splitlines()
    assert [line.partition("M ")[2] for line in shown] == lines

    page.get_by_role("link", name="Compare with toys:1").click()
    comparison = page.locator(".comparison")
    comparison.get_by_text("From toys:1 to toys:2").wait_for()
    box = comparison.bounding_box()
    assert box is not None
    assert box["y"] + min(box["height"], 300) <= DESKTOP[1] + 1  # it is to be seen
    compared = told(host, "models/toys/versions/1/compare", **{"with": "toys:2"})
    assert comparison.locator("tbody tr").count() >= len(compared["old_concepts"])
    assert comparison.locator(".fate").count() == len(compared["fates"])

    assert serving(page) == "toys:1"
    page.get_by_role("button", name="Promote").click()
    page.get_by_role("dialog").get_by_role("button", name="Promote").click()
    page.get_by_role("button", name="Roll back to version 1").wait_for()
    assert serving(page) == "toys:2"
    assert told(host, "models/toys")["aliases"]["production"] == 2
    page.get_by_role("button", name="Roll back to version 1").click()
    page.keyboard.press("Escape")  # nobody is sure
    assert told(host, "models/toys")["aliases"]["production"] == 2
    page.get_by_role("button", name="Roll back to version 1").click()
    page.get_by_role("dialog").get_by_role("button", name="Roll back").click()
    page.get_by_text("No version served before version 1").wait_for()
    assert serving(page) == "toys:1"
    assert told(host, "models/toys")["aliases"]["production"] == 1
    visited.check()


@pytest.mark.usefixtures("worker")
def test_an_evaluation_shows_what_tells_each_label_apart(visit: Visiting, host: str) -> None:
    visited = visit("#/train")
    page = visited.page
    page.get_by_label("Judge a model").check()
    page.get_by_label("Model", exact=True).first.select_option("toys:1")
    page.get_by_label("By the labels of").select_option("shelf")
    page.get_by_role("button", name="Submit").click()
    state(page, "done")
    job(page).get_by_role("rowheader", name="kind 1").wait_for()
    name = page.url.partition("job=")[2].partition("&")[0]
    by_label = told(host, f"jobs/{name}/report.json")["by_label"]
    cells = job(page).locator("tr", has_text="kind 1").locator("td").all_inner_texts()
    assert cells[1:] == [f"{by_label['kind 1'][figure]:.2f}" for figure in ("knn", "svm", "within", "assigned")]
    with visited.page.context.expect_page() as opened:
        job(page).get_by_role("link", name="The whole report").click()
    opened.value.get_by_role("heading").first.wait_for()
    visited.check()


@pytest.mark.usefixtures("worker")
def test_a_job_is_cancelled_and_let_go_on(visit: Visiting, host: str) -> None:
    page = visit("#/train").page
    page.get_by_label("Simulate clouds").check()
    page.get_by_label("Objects", exact=True).fill("20000")
    page.get_by_label("Renderer").select_option("raycast")
    page.get_by_role("button", name="Submit").click()
    state(page, "running")
    for focused, anew in ((".job-list a", ".job-list li"), (".job .danger", ".job .stages")):
        page.locator(focused).focus()
        page.locator(anew).evaluate("(element) => element.setAttribute('data-before', '')")
        page.locator(f"{anew}:not([data-before])").wait_for()  # there are news
        assert page.locator(focused).evaluate("(element) => element === document.activeElement")
    page.keyboard.press("Enter")
    state(page, "cancelled")
    page.get_by_role("button", name="Retry").click()
    state(page, "running")
    name = page.url.partition("job=")[2].partition("&")[0]
    assert told(host, f"jobs/{name}")["state"] == "running"
    assert page.locator(".job-list li").count() == 1


def test_a_lost_connection_is_told_and_made_good_without_a_line_twice(browser: Browser, place: Place) -> None:
    port = free_port()
    place.submit("slow")
    visited = Visit(browser, f"http://127.0.0.1:{port}")
    with place.api(port):
        page = visited.open("#/train?job=slow")
        place.queue.note("slow", "first")
        job(page).get_by_text("first").wait_for()
    page.get_by_text("The connection is lost; trying again").wait_for()
    place.queue.note("slow", "second")
    with place.api(port):
        job(page).get_by_text("second").wait_for()
        assert page.get_by_text("The connection is lost").is_hidden()
        place.queue.cancel("slow")
        state(page, "cancelled")
    lines = [line.partition("M ")[2] for line in job(page).locator(".log").inner_text().splitlines()]
    assert lines == ["first", "second", "cancelled"]
    assert visited.complaints == []
    visited.close()


@pytest.mark.usefixtures("worker")
def test_why_a_job_failed_stands_beside_it(visit: Visiting, place: Place) -> None:
    Datasets(place.store.url).create("empty")
    page = visit("#/train").page
    page.get_by_label("empty", exact=True).check()
    page.get_by_label("simulated objects", exact=True).uncheck()
    page.get_by_role("button", name="Submit").click()
    state(page, "failed")
    refused = job(page).get_by_role("alert").inner_text()
    assert "empty" in refused
    assert refused.strip().splitlines()[-1] == told(page.url.partition("/#")[0], "jobs")["jobs"][0]["error"]["detail"]
