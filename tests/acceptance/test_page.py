"""The page in a real browser, on a real service: Try and Concepts, with mouse and keys, on phone and desktop."""

from __future__ import annotations

import dataclasses
import io
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import httpx
import numpy as np
import pytest

from service.clouds import write_ply
from service.datasets import Datasets
from service.engine.cloud import PointCloud
from service.keys import KeyStore
from service.labels import Label
from tests.acceptance.browsing import DESKTOP, PHONE, Visit, chromium, colours, picture
from tests.acceptance.jobs_place import Place, free_port, wait_until
from tests.learnt import learnt, objects
from tests.service.clouds.written import every_kind, png

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Route

pytestmark = pytest.mark.slow
CLOUD = ".cloud-canvas"
Visiting = Callable[..., Visit]


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as browser:
        yield browser


@pytest.fixture(scope="module")
def host(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A service with a model of objects of which some have labels, `toys:1`."""
    place = Place(tmp_path_factory.mktemp("place"))
    datasets = Datasets(place.store.url)
    datasets.create("shelf")
    for number in range(6):
        datasets.add("shelf", f"{number}.ply", write_ply(objects()[number].cloud))
    datasets.label("shelf", {f"{number}.ply": Label(category="ball" if number % 3 else "brick") for number in range(6)})
    keys = tuple(f"shelf/{number}.ply" if number < 6 else f"simulated/5/{number}" for number in range(14))
    model = dataclasses.replace(learnt(), prototypes=dataclasses.replace(learnt().prototypes, cloud_keys=keys))
    source = {"kind": "joined", "clouds": 14, "parts": [{"kind": "dataset", "name": "shelf", "clouds": 6}]}
    place.store.publish(model, name="toys", seed=5, source=source)
    port = free_port()
    with place.api(port):
        yield f"http://127.0.0.1:{port}"


@pytest.fixture
def visit(browser: Browser, host: str) -> Iterator[Visiting]:
    """Opens the page; in the end the browser had nothing to complain about, unless the test looked itself."""
    opened: list[Visit] = []

    def opening(place: str, size: tuple[int, int] = DESKTOP, scheme: str = "light", at: str = host) -> Visit:
        opened.append(Visit(browser, at, size, scheme))
        opened[-1].open(place)
        return opened[-1]

    yield opening
    for one in opened:
        one.close()


def asked(host: str, content: bytes, **query: object) -> dict[str, Any]:
    """What the service answers without a browser."""
    answer: dict[str, Any] = httpx.post(f"{host}/v1/responses", params=query, content=content, timeout=60).json()
    return answer


def fingertips(count: int) -> bytes:
    """A dense bowl-like cloud as NPY."""
    rng = np.random.default_rng(0)
    across = rng.uniform(-0.1, 0.1, (count, 2))
    points = np.column_stack([across, 0.6 + 4 * (across**2).sum(axis=1)]).astype(np.float32)
    file = io.BytesIO()
    np.save(file, points)
    return file.getvalue()


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
