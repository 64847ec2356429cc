"""Try, in a real browser: clouds and scenes picked and dropped, answered, drawn, explained."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import httpx
import numpy as np
import pytest

from service.clouds import write_ply
from service.engine.cloud import PointCloud
from tests.acceptance.browsing import PHONE, colours, picture
from tests.acceptance.page.visiting import CLOUD, Visiting, asked, fingertips
from tests.learnt import objects
from tests.service.clouds.written import every_kind, png

if TYPE_CHECKING:
    from playwright.sync_api import Route

pytestmark = pytest.mark.slow


class TestTry:
    def test_a_sample_is_drawn_and_answered_as_the_service_answers_it(self, visit: Visiting, host: str) -> None:
        visited = visit("#/try")
        page = visited.page
        page.get_by_role("button", name="A sphere and a box").click()
        page.wait_for_selector(".why")
        assert "sample=object-2.ply" in page.url
        expected = asked(host, httpx.get(f"{host}/page/samples/object-2.ply").content, model="toys")
        own = [concept for concept in expected["concepts"] if concept["time"] == expected["time"]]
        told = page.locator(".answer > section").first.locator("> div > .ranked .rank-name").all_inner_texts()
        assert told == [f"Concept {concept['id']}" for concept in own[:6]]
        link = page.locator(".rank-name").first.get_attribute("href")
        assert link == f"#/concepts?model=toys:1&concept={own[0]['id']}"
        assert page.locator(".novelty .number").inner_text() == f"{round(100 * expected['novelty'])} %"
        assert page.locator(".timings li > span:first-child").all_inner_texts()[:2] == ["decode", "normalise"]
        assert page.locator(".legend-entry").count() == expected["segments"]
        page.locator(".thumbnail:not(.missing)").nth(5).wait_for()
        assert colours(page, ".thumbnails .thumbnail") > 10
        assert colours(page, CLOUD) > 50
        visited.check()

    def test_what_fired_stands_out_in_the_cloud_by_mouse_and_by_keys(self, visit: Visiting) -> None:
        page = visit("#/try?sample=object-3.ply").page
        page.wait_for_selector(".why .line")
        page.locator(".legend-entry").nth(1).wait_for()
        page.wait_for_timeout(200)
        plain = picture(page, CLOUD)
        segments = page.locator(".why .lines").nth(1).locator(".line")
        segments.nth(1).hover()
        page.wait_for_timeout(200)
        second = picture(page, CLOUD)
        segments.nth(0).focus()
        page.wait_for_timeout(200)
        first = picture(page, CLOUD)
        assert len({plain, first, second}) == 3

    def test_on_a_phone_the_cloud_stays_in_sight_while_its_explanation_is_read(self, visit: Visiting) -> None:
        page = visit("#/try?sample=object-3.ply", PHONE).page
        page.wait_for_selector(".why .line")
        page.locator(".why .line").last.focus()
        page.wait_for_timeout(300)
        cloud, line = page.locator(CLOUD).bounding_box(), page.locator(".why .line").last.bounding_box()
        assert cloud is not None
        assert line is not None
        assert 0 <= cloud["y"] < cloud["y"] + cloud["height"] <= line["y"] < PHONE[1]

    def test_every_way_to_colour_a_cloud_has_a_legend_and_stands_in_the_url(self, visit: Visiting) -> None:
        visited = visit("#/try?sample=object-4.ply")
        page = visited.page
        page.locator("#colour option").nth(3).wait_for(state="attached")
        shown = set()
        for value in page.locator("#colour option").evaluate_all("options => options.map(option => option.value)"):
            page.locator("#colour").select_option(value)
            page.wait_for_timeout(150)
            assert page.locator(".legend-entry").count() > 0, value
            assert f"colour={value}" in page.url
            shown.add(picture(page, CLOUD))
        assert len(shown) > 3
        page.locator("#colour").select_option("height")
        other = visited.again(page.url)
        other.wait_for_selector(".why")
        assert other.locator("#colour").input_value() == "height"
        visited.check()

    def test_a_scene_has_an_answer_for_each_object(self, visit: Visiting, host: str) -> None:
        visited = visit("#/try?sample=scene.ply")
        page = visited.page
        page.wait_for_selector(".objects .object")
        file = httpx.get(f"{host}/page/samples/scene.ply").content
        expected = asked(host, file, model="toys", scene="true")["objects"]
        assert page.locator(".objects .object").count() == len(expected) == 3
        for one in expected:
            page.locator(".objects .object").nth(one["number"]).click()
            assert page.locator(".best h2").inner_text() == f"Concept {one['answer']['concepts'][0]['id']}"
        page.locator(".cloud-marks .mark").first.click()
        assert page.locator(".object[aria-pressed=true]").count() == 1
        visited.check()

    @pytest.mark.parametrize("kind", ["pcd compressed", "npz deflated", "json list", "pointcloud2 big", "xyz commas"])
    def test_files_that_no_browser_reads_are_drawn(self, visit: Visiting, kind: str) -> None:
        visited = visit("#/try")
        page = visited.page
        ending = {"pointcloud2": "cdr"}.get(kind.split()[0], kind.split()[0])
        data = every_kind(objects()[0].cloud.points)[kind]
        page.locator("#file").set_input_files({"name": f"scan.{ending}", "mimeType": "", "buffer": data})
        page.wait_for_selector(".why")
        assert colours(page, CLOUD) > 20
        visited.check()

    def test_a_depth_image_needs_its_camera_and_is_drawn_with_it(self, visit: Visiting) -> None:
        visited = visit("#/try")
        page = visited.page
        rows, columns = np.mgrid[:48, :64]
        ball = 800 - np.sqrt(np.maximum(0, 20**2 - (rows - 24) ** 2 - (columns - 32) ** 2))
        depth = np.where((rows - 24) ** 2 + (columns - 32) ** 2 < 400, ball, 0).astype(np.uint16)
        page.locator("#file").set_input_files({"name": "depth.png", "mimeType": "image/png", "buffer": png(depth)})
        page.get_by_role("alert").get_by_text("intrinsics").wait_for()
        page.get_by_text("Formats, unit").click()
        page.get_by_label("Camera of a depth image").fill("60,60,31.5,23.5")
        page.get_by_role("button", name="Ask again").click()
        page.wait_for_selector(".why")
        assert colours(page, CLOUD) > 20
        visited.check((422, "/v1/points"), (422, "/v1/responses"))

    def test_a_wrong_file_gets_the_services_own_error_in_place(self, visit: Visiting, host: str) -> None:
        visited = visit("#/try")
        page = visited.page
        page.locator("#file").set_input_files({"name": "notes.docx", "mimeType": "", "buffer": b"\x00\x01 no cloud"})
        alert = page.get_by_role("alert")
        alert.wait_for()
        form = {"cloud": ("notes.docx", b"\x00\x01 no cloud", "application/octet-stream")}
        expected = httpx.post(f"{host}/v1/responses", files=form).json()
        assert expected["detail"] in alert.inner_text()
        assert not page.locator(".try-cloud").is_visible()
        page.get_by_role("button", name="A cylinder", exact=True).click()  # and all is well again
        page.wait_for_selector(".why")
        assert page.get_by_role("alert").count() == 0
        visited.check((415, "/v1/points"), (415, "/v1/responses"))

    def test_a_file_that_was_changed_since_it_was_picked_is_to_be_picked_again(
        self, visit: Visiting, tmp_path: Path
    ) -> None:
        visited = visit("#/try")
        page = visited.page
        scan = tmp_path / "scan.ply"
        scan.write_bytes(write_ply(objects()[0].cloud))
        page.locator("#file").set_input_files(scan)
        page.wait_for_selector(".why")
        scan.write_bytes(write_ply(objects()[1].cloud))
        page.get_by_text("A whole scene").click()
        page.get_by_role("alert").get_by_text("scan.ply is a folder, or was changed").wait_for()
        assert not page.locator(".try-cloud").is_visible()
        page.get_by_text("One object").click()
        page.locator("#file").set_input_files(scan)
        page.wait_for_selector(".why")
        visited.check()

    def test_a_cloud_that_cannot_be_answered_is_drawn_nevertheless(self, visit: Visiting) -> None:
        visited = visit("#/try")
        page = visited.page
        few = write_ply(PointCloud(objects()[0].cloud.points[:40]))
        page.locator("#file").set_input_files({"name": "few.ply", "mimeType": "", "buffer": few})
        page.get_by_role("alert").wait_for()
        page.get_by_text("40 points. Drag").wait_for()
        assert colours(page, CLOUD) > 5
        visited.check((422, "/v1/responses"))

    def test_of_two_samples_the_one_picked_last_is_shown_whichever_comes_first(self, visit: Visiting) -> None:
        visited = visit("#/try")
        page = visited.page
        page.wait_for_selector(".samples button")
        held: list[Route] = []
        page.route("**/samples/object-1.ply", lambda route: held.append(route))
        page.get_by_role("button", name="A cylinder", exact=True).click()
        page.get_by_role("button", name="A sphere and a box").click()
        page.wait_for_selector(".why")
        assert page.locator(".try-cloud h2").inner_text() == "object-2.ply"
        assert len(held) == 1
        held[0].continue_()
        page.wait_for_load_state("networkidle")
        assert page.locator(".try-cloud h2").inner_text() == "object-2.ply"
        assert page.locator(".samples [aria-pressed=true]").inner_text() == "A sphere and a box"
        visited.check()

    def test_points_that_do_not_come_are_told_in_their_place_beside_the_answer(self, visit: Visiting) -> None:
        visited = visit("#/try")
        page = visited.page
        page.wait_for_selector(".samples button")
        page.route("**/v1/points*", lambda route: route.abort())
        page.get_by_role("button", name="A sphere and a box").click()
        page.wait_for_selector(".why")
        page.locator(".try-cloud").get_by_text("cannot be reached").wait_for()
        page.unroute("**/v1/points*")
        page.get_by_role("button", name="Try again").click()
        page.locator(".legend-entry").first.wait_for()
        assert page.get_by_role("alert").count() == 0
        assert colours(page, CLOUD) > 50
        visited.check()

    def test_a_million_points_are_thinned_for_display_alone(self, visit: Visiting) -> None:
        visited = visit("#/try")
        page = visited.page
        page.locator("#file").set_input_files({"name": "bowl.npy", "mimeType": "", "buffer": fingertips(1_000_000)})
        page.get_by_text("1,000,000 points, of which 100,000 are drawn").wait_for()
        page.wait_for_selector(".why")
        before = picture(page, CLOUD)
        box = page.locator(CLOUD).bounding_box()
        assert box is not None
        page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        page.mouse.down()
        page.mouse.move(box["x"] + box["width"] / 2 + 80, box["y"] + box["height"] / 2, steps=8)
        page.mouse.up()
        page.wait_for_timeout(300)
        assert picture(page, CLOUD) != before
        visited.check()

    def test_a_file_can_be_dropped(self, visit: Visiting) -> None:
        visited = visit("#/try")
        page = visited.page
        page.wait_for_selector(".samples button")
        lines = "".join(f"{x:.4f} {y:.4f} {z:.4f}\n" for x, y, z in objects()[1].cloud.points.tolist())
        page.evaluate(
            """(text) => {
                const transfer = new DataTransfer();
                for (const name of ["dropped.xyz", "other.xyz"]) transfer.items.add(new File([text], name));
                document.querySelector("main").dispatchEvent(
                    new DragEvent("drop", { dataTransfer: transfer, bubbles: true, cancelable: true }));
            }""",
            lines,
        )
        page.wait_for_selector(".why")
        assert page.locator(".try-cloud h2").inner_text() == "dropped.xyz"
        page.get_by_text("Of the 2 files, only dropped.xyz is asked about").wait_for()
        visited.check()
