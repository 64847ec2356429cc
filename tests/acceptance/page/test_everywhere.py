"""What holds of every view of the page: addresses, keys, sizes and schemes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import httpx
import pytest

from service.keys import KeyStore
from tests.acceptance.browsing import DESKTOP, PHONE, Visit
from tests.acceptance.jobs_place import Place, free_port, wait_until
from tests.acceptance.page.visiting import Visiting
from tests.learnt import learnt

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = pytest.mark.slow


class TestEverywhere:
    @pytest.mark.parametrize(
        ("place", "refused"),
        [
            ("#/concepts?model=../../healthz", {(404, "/v1/models/..%2F..%2Fhealthz")}),
            ("#/train?job=../../v1/jobs%3Fx%3D", {(404, "/v1/jobs/..%2F..%2Fv1%2Fjobs%3Fx%3D/events")}),
        ],
    )
    def test_an_address_reaches_nothing_but_what_it_names(
        self, visit: Visiting, place: str, refused: set[tuple[int, str]]
    ) -> None:
        visited = visit(place)
        visited.page.get_by_role("alert").wait_for()
        visited.check(*refused)

    @pytest.mark.parametrize("place", ["#/nonsense?time=abc", "#/%E0%A4%A", "#/try?sample=none&colour=no&time=-"])
    def test_an_address_that_means_nothing_opens_the_first_view(self, visit: Visiting, place: str) -> None:
        visited = visit(place)
        page = visited.page
        page.get_by_role("button", name="A sphere and a box").click()
        page.wait_for_selector(".why")
        assert "#/try?" in page.url
        visited.check()

    @pytest.mark.parametrize("view", ["concepts", "train", "live"])
    def test_a_file_that_is_dropped_beside_what_takes_it_does_not_take_the_pages_place(
        self, visit: Visiting, view: str
    ) -> None:
        page = visit(f"#/{view}").page
        page.locator("main h1").wait_for(state="attached")
        for kind in ("dragover", "drop"):
            assert not page.evaluate(
                """(kind) => {
                    const dataTransfer = new DataTransfer();
                    dataTransfer.items.add(new File(["1 2 3"], "stray.xyz"));
                    const event = new DragEvent(kind, { dataTransfer, bubbles: true, cancelable: true });
                    return document.querySelector("main").dispatchEvent(event);
                }""",
                kind,
            )

    @pytest.mark.parametrize("scheme", ["light", "dark"])
    @pytest.mark.parametrize("size", [PHONE, DESKTOP], ids=["phone", "desktop"])
    @pytest.mark.parametrize("place", ["#/try?sample=scene.ply", "#/concepts?time=0.9", "#/train", "#/live"])
    def test_nothing_is_wider_than_the_screen(
        self, visit: Visiting, place: str, size: tuple[int, int], scheme: str, tmp_path: Path
    ) -> None:
        visited = visit(place, size, scheme)
        page = visited.page
        page.wait_for_load_state("networkidle")
        assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
        ground = page.evaluate("getComputedStyle(document.documentElement).backgroundColor")
        light = sum(json.loads(f"[{ground[4:-1]}]")) / 3
        assert (light > 127) == (scheme == "light")
        visited.check()

    def test_views_are_reached_by_keys_alone(self, visit: Visiting) -> None:
        visited = visit("#/try")
        page = visited.page
        page.wait_for_selector(".samples button")
        reached = []
        for _ in range(30):
            page.keyboard.press("Tab")
            reached.append(page.evaluate("document.activeElement.textContent.trim() || document.activeElement.id"))
        for wanted in ("Try", "Concepts", "Train", "Live", "Access key", "file", "A cylinder"):
            assert wanted in reached, reached
        page.locator("nav a", has_text="Concepts").focus()
        page.keyboard.press("Enter")
        page.wait_for_selector(".concept-row")
        page.locator(".concept-row").first.focus()
        page.keyboard.press("Enter")
        page.wait_for_selector(".detail .best")
        page.go_back()
        page.wait_for_selector(".samples button")
        visited.check()

    def test_a_key_is_asked_for_where_one_is_needed_and_kept_for_this_tab(
        self, browser: Browser, host: str, tmp_path: Path
    ) -> None:
        place = Place(tmp_path, access="keys")
        place.store.publish(learnt(), name="toys", seed=5, source={})
        asker = KeyStore(place.store.url).create("page", ("answer",), concurrency=1)
        port = free_port()
        with place.api(port):
            visited = Visit(browser, f"http://127.0.0.1:{port}")
            page = visited.open("#/concepts")
            page.get_by_role("alert").get_by_role("button", name="Enter a key").click()
            page.get_by_label("Key", exact=True).fill("wrong")
            page.get_by_role("button", name="Use it").click()
            page.get_by_role("alert").wait_for()
            page.locator("#key").click()
            page.get_by_label("Key", exact=True).fill(asker.text)
            page.get_by_role("button", name="Use it").click()
            page.locator(".concept-row").first.click()
            page.wait_for_selector(".prototypes .thumbnail")
            page.wait_for_load_state("networkidle")
            assert page.locator(".thumbnail.missing").count() == 0
            page.get_by_label("Name", exact=True).fill("block")
            page.get_by_role("button", name="Save").click()
            page.get_by_text("does not allow this").wait_for()
            assert page.evaluate("[localStorage.length, document.cookie]") == [0, ""]
            statuses = {status for status, _ in visited.refusals}
            visited.close()
            assert (visited.complaints, visited.elsewhere) == ([], [])
            assert {401, 403} <= statuses <= {401, 403, 429}  # requests that were not let in were sent again

    def test_a_service_that_is_away_is_told_and_can_be_tried_again(self, browser: Browser, tmp_path: Path) -> None:
        place = Place(tmp_path)
        place.store.publish(learnt(), name="toys", seed=5, source={})
        port = free_port()
        visited = Visit(browser, f"http://127.0.0.1:{port}")
        with place.api(port):
            page = visited.open("#/try")
            page.wait_for_selector(".samples button")
            page.locator("nav a", has_text="Concepts").click()
            page.wait_for_selector(".concept-row")
            page.locator("nav a", has_text="Try").click()
            page.wait_for_selector(".samples button")
        page.get_by_role("button", name="A cylinder", exact=True).click()
        page.get_by_role("alert").get_by_text("cannot be reached").wait_for()
        with place.api(port):
            wait_until(lambda: httpx.get(f"http://127.0.0.1:{port}/healthz").status_code == 200, "the service")
            page.get_by_role("button", name="Try again").click()
            page.wait_for_selector(".why")
        visited.close()
