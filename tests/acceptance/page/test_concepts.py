"""Concepts, in a real browser: four views with one selection, and names."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import httpx
import pytest

from tests.acceptance.browsing import Visit, picture
from tests.acceptance.jobs_place import Place, free_port
from tests.acceptance.page.visiting import Visiting
from tests.learnt import learnt

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Route

pytestmark = pytest.mark.slow


class TestConcepts:
    def test_concepts_at_a_time_are_those_of_the_service_whatever_view_sets_it(
        self, visit: Visiting, host: str
    ) -> None:
        visited = visit("#/concepts")
        page = visited.page
        page.wait_for_selector(".concept-row")

        def listed() -> list[int]:
            page.wait_for_timeout(150)
            return [int(number) for number in page.locator(".concept-row .number").all_inner_texts()]

        def expected(time: float) -> list[int]:
            answer = httpx.get(f"{host}/v1/models/toys:1/concepts", params={"time": time}).json()
            return [concept["prototypes"] for concept in answer["concepts"]]

        epsilon = httpx.get(f"{host}/v1/models/toys:1/barcode").json()["epsilon_max"]
        assert listed() == expected(epsilon)
        page.locator("#time").focus()
        for _ in range(30):
            page.keyboard.press("ArrowLeft")
        by_keys = float(page.locator("#time").input_value())
        assert by_keys < epsilon
        assert listed() == expected(by_keys)
        canvas = page.locator(".over-time canvas").first
        box = canvas.bounding_box()
        assert box is not None
        page.mouse.move(box["x"] + box["width"] * 0.4, box["y"] + 60)
        page.mouse.down()
        page.mouse.move(box["x"] + box["width"] * 0.95, box["y"] + 60, steps=6)
        page.mouse.up()
        page.wait_for_timeout(200)
        dragged = float(page.url.rpartition("time=")[2].partition("&")[0])
        assert 0.9 < dragged < 1
        assert listed() == expected(dragged)
        visited.check()

    def test_one_selection_is_shown_in_all_views_and_an_address_brings_it_back(self, visit: Visiting) -> None:
        visited = visit("#/concepts")
        page = visited.page
        page.wait_for_selector(".concept-row")
        charts = [".over-time canvas", ".tree canvas", ".tall canvas"]
        plain = [picture(page, chart) for chart in charts]
        page.locator(".concept-row").first.click()
        page.wait_for_timeout(200)
        chosen = [picture(page, chart) for chart in charts]
        assert all(before != after for before, after in zip(plain, chosen, strict=True))
        title = page.locator(".detail h2").inner_text()
        assert page.locator(".prototypes figure").count() == int(
            page.locator(".concept-row .number").first.inner_text()
        )
        other = visited.again(page.url)
        other.wait_for_selector(".detail .best")
        assert other.locator(".detail h2").inner_text() == title
        assert other.locator(".concept-row[aria-pressed=true]").count() == 1
        visited.check()

    def test_a_click_in_the_map_the_tree_or_the_barcode_chooses_a_concept(self, visit: Visiting) -> None:
        visited = visit("#/concepts?time=1")
        page = visited.page
        page.wait_for_selector(".concept-row")
        for chart in (".over-time:not(.tree) canvas", ".tree canvas"):  # at 1, all are one concept
            page.locator(chart).click(position={"x": 40, "y": 40})
            page.wait_for_selector(".detail .best")
            page.locator(".concept-row[aria-pressed=true]").click()
            page.wait_for_selector(".detail .state")
        visited.check()

    def test_labels_tell_how_pure_a_concept_is(self, visit: Visiting) -> None:
        page = visit("#/concepts?time=1").page
        page.wait_for_selector(".concept-row")
        assert "ball, 67 % pure" in page.locator(".concept-row").first.inner_text()
        page.locator(".concept-row").first.click()
        page.get_by_text("Of 6 labelled objects 67 % are ball.").wait_for()

    def test_a_concept_is_named_here_and_called_so_everywhere(self, visit: Visiting, host: str) -> None:
        visited = visit("#/concepts")
        page = visited.page
        page.locator(".concept-row").first.click()
        page.get_by_label("Name", exact=True).fill("  handy <b>block</b> ")
        page.get_by_role("button", name="Save").click()
        page.get_by_role("heading", name="handy <b>block</b>").wait_for()
        names = httpx.get(f"{host}/v1/models/toys/names").json()["names"]
        assert [entry["name"] for entry in names] == ["handy <b>block</b>"]
        page.goto(f"{host}/#/try?sample=object-2.ply")
        page.wait_for_selector(".why")
        assert "handy <b>block</b>" in page.locator(".rank-name").all_inner_texts()
        page.goto(f"{host}/#/concepts?concept={names[0]['concept']}")
        page.get_by_role("button", name="Take away").click()
        page.get_by_role("heading", name=f"Concept {names[0]['concept']}").wait_for()
        assert httpx.get(f"{host}/v1/models/toys/names").json()["names"] == []
        visited.check()

    def test_the_way_back_leads_to_the_model_that_was_shown_before(self, browser: Browser, tmp_path: Path) -> None:
        place = Place(tmp_path)
        for seed in (5, 6):
            place.store.publish(learnt(), name="toys", seed=seed, source={})
        port = free_port()
        visited = Visit(browser, f"http://127.0.0.1:{port}")
        with place.api(port):
            page = visited.open("#/concepts")
            page.get_by_text("of toys:2.").wait_for()
            page.locator("#model").select_option("toys:1")
            page.get_by_text("of toys:1.").wait_for()
            page.locator(".concept-row").first.click()
            page.go_back()
            page.get_by_text("of toys:2.").wait_for()
            assert page.locator("#model").input_value() == "toys:2"
            held: list[Route] = []
            page.route("**/toys:1/annexations", lambda route: held.append(route))
            page.reload()
            page.get_by_text("of toys:2.").wait_for()
            page.locator("#model").select_option("toys:1")
            with page.expect_response("**/toys:1/labels"):
                pass
            page.go_back()  # while it is loaded
            page.get_by_text("of toys:2.").wait_for()
            held[0].continue_()
            page.wait_for_load_state("networkidle")
            page.get_by_text("of toys:2.").wait_for()
            assert page.locator("#model").input_value() == "toys:2"
        visited.close()
        assert visited.complaints == []

    def test_a_model_that_is_not_there_is_told_in_the_services_words(self, visit: Visiting) -> None:
        visited = visit("#/concepts?model=nobody:3")
        visited.page.get_by_role("alert").get_by_text("nobody").wait_for()
        visited.check((404, "/v1/models/nobody:3"))
