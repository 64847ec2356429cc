"""Train in a real browser: jobs and schedules submitted, by whom it is allowed, by keys alone, on any screen."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from service.engine.params import ModelParams
from service.keys import KeyStore
from tests.acceptance.browsing import DESKTOP, PHONE, Visit
from tests.acceptance.jobs_place import Place, free_port
from tests.acceptance.page.train.using import drop, learn, ply, serving, state, told, verdicts
from tests.acceptance.page.visiting import Visiting

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = pytest.mark.slow


def test_parameters_that_were_altered_are_sent_and_others_are_not(visit: Visiting, host: str) -> None:
    visited = visit("#/train")
    page = visited.page
    page.get_by_text("Seed and parameters").click()
    page.get_by_label("Seed", exact=True).fill("11")
    page.get_by_label("fewest parts").fill("4")
    page.get_by_label("most parts").fill("2")  # fewer than the fewest: the browser says so itself
    page.get_by_role("button", name="Submit").click()
    page.get_by_label("fewest parts").fill("1")
    page.get_by_text("Parameters of every stage").click()
    page.locator(".stage-parameters summary", has_text="dictionary").click()
    page.get_by_label("levels", exact=True).fill("3")
    page.get_by_role("button", name="Submit").click()
    state(page, "queued")
    spec = told(host, "jobs")["jobs"][0]["spec"]
    assert (spec["seed"], spec["simulate"], spec["simulation"]) == (11, 250, {"orders": [1, 2]})
    assert spec["params"]["dictionary"] == {"levels": 3}
    page.get_by_label("Begin with").select_option(label="the paper's own choices")
    page.get_by_role("button", name="Submit").click()
    page.locator(".job-list li").nth(1).wait_for()
    spec = told(host, "jobs")["jobs"][0]["spec"]
    assert ModelParams.model_validate(spec["params"]) == ModelParams.preset("paper")
    page.get_by_label("levels", exact=True).fill("99")  # out of its range: the browser says so itself
    page.get_by_text("Seed and parameters").click()
    page.get_by_label("levels", exact=True).wait_for(state="hidden")
    page.get_by_role("button", name="Submit").click()
    page.get_by_label("levels", exact=True).wait_for()
    assert len(told(host, "jobs")["jobs"]) == 2
    visited.check()


def test_who_may_not_train_is_told_so_where_they_tried(browser: Browser, place: Place) -> None:
    place.environment["SHAPE_CONCEPTS_ACCESS"] = "keys"
    keys = KeyStore(place.store.url)
    text, training = (keys.create(scope, (scope,)).text for scope in ("answer", "train"))
    port = free_port()
    with place.api(port):
        visited = Visit(browser, f"http://127.0.0.1:{port}")
        page = visited.open("#/train")
        page.get_by_text("An access key is needed").first.wait_for()
        page.wait_for_load_state("networkidle")
        assert page.get_by_role("alert").count() == 1  # it is said once
        page.get_by_role("button", name="Access key").click()
        page.get_by_role("dialog").get_by_label("Key", exact=True).fill(text)
        page.get_by_role("button", name="Use it").click()
        page.get_by_text("14 clouds,").wait_for()  # who may ask may look
        assert serving(page) == "toys:1"
        page.get_by_role("button", name="Submit").click()
        page.get_by_role("alert").get_by_text("not to train").wait_for()
        drop(page, {"0.ply": ply(0)})
        page.locator(".drop").get_by_role("alert").get_by_text("not to train").wait_for()
        page.get_by_role("button", name="Access key", exact=True).click()
        page.get_by_role("dialog").get_by_label("Key", exact=True).fill(training)
        page.get_by_role("button", name="Use it").click()
        page.locator(".holds").get_by_text("14 clouds,").wait_for()  # but for the models, which it may not read
        page.locator("section", has_text="Versions").get_by_role("alert").get_by_text("not to answer").wait_for()
        learn(page, "mine")
        state(page, "queued")
        drop(page, {"new.ply": ply(0)})
        assert verdicts(page) == {"new.ply": "taken"}
        assert {status for status, _ in visited.refusals} == {401, 403}
        assert visited.complaints == []
        visited.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", [PHONE, DESKTOP])
def test_nothing_is_wider_than_the_screen_and_every_control_says_what_it_is(
    visit: Visiting, place: Place, size: tuple[int, int], scheme: str
) -> None:
    place.submit("waits")
    visited = visit("#/train?job=waits", size, scheme)
    page = visited.page
    state(page, "queued")
    page.get_by_text("14 clouds,").wait_for()
    assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
    unnamed = page.evaluate(
        """() => [...document.querySelectorAll("main :is(input, select, button, a, summary)")]
            .filter((each) => each.getAttribute("aria-hidden") !== "true" && !each.labels?.length
                && !each.getAttribute("aria-label") && !each.textContent.trim())
            .map((each) => each.outerHTML)"""
    )
    assert unnamed == []
    visited.check()


def test_a_job_is_submitted_by_keys_alone(visit: Visiting, host: str) -> None:
    page = visit("#/train").page
    page.get_by_text("14 clouds,").wait_for()
    page.get_by_label("Learn a model").focus()
    page.keyboard.press("ArrowRight")
    assert page.get_by_label("Simulate clouds").is_checked()
    reached = set()
    for _ in range(12):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.textContent.trim() || document.activeElement.id"))
        if "Submit" in reached:
            break
    assert "Submit" in reached
    page.keyboard.press("Enter")
    state(page, "queued")
    assert told(host, "jobs")["jobs"][0]["spec"]["kind"] == "simulate"


def test_a_job_is_put_on_a_schedule_which_is_paused_and_removed(visit: Visiting, host: str) -> None:
    visited = visit("#/train")
    page = visited.page
    page.get_by_text("14 clouds,").wait_for()
    assert page.get_by_role("heading", name="Schedules").is_hidden()
    page.get_by_label("Name of the model").fill("toys")
    page.get_by_text("Again and again, on a schedule").click()
    page.get_by_label("Times").fill("0 25 * * *")
    page.get_by_role("button", name="Make the schedule").click()
    page.get_by_role("alert").wait_for()
    page.get_by_label("Times").fill("0 3 * * mon")
    page.get_by_label("Time zone").fill("Europe/Berlin")
    page.get_by_role("button", name="Make the schedule").click()
    page.get_by_text("nightly is due next").wait_for()
    (made,) = told(host, "schedules")["schedules"]
    assert (made["cron"], made["zone"], made["job"]["name"]) == ("0 3 * * mon", "Europe/Berlin", "toys")
    panel = page.locator("section", has=page.get_by_role("heading", name="Schedules"))
    panel.get_by_role("button", name="Pause").click()
    panel.get_by_role("button", name="Resume").wait_for()
    assert told(host, "schedules")["schedules"][0]["state"] == "paused"
    panel.get_by_role("button", name="Remove").click()
    page.get_by_role("dialog").get_by_role("button", name="Remove").click()
    panel.wait_for(state="hidden")
    assert told(host, "schedules")["schedules"] == []
    assert told(host, "jobs")["jobs"] == []
    visited.check((422, "/v1/schedules"))
