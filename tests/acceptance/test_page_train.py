"""Train in a real browser: files dropped, jobs of a real worker followed, versions compared, promoted, taken back."""

from __future__ import annotations

import base64
import io
import zipfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import httpx
import pytest

from service.clouds import write_ply
from service.datasets import Datasets
from service.engine.params import ModelParams
from service.keys import KeyStore
from service.labels import Label
from tests.acceptance.browsing import DESKTOP, PHONE, Visit, chromium
from tests.acceptance.jobs_place import Place, free_port
from tests.learnt import learnt, objects

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Locator, Page, Route

pytestmark = pytest.mark.slow
Visiting = Callable[..., Visit]
JOB = 120_000  # milliseconds that a small job may take


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as browser:
        yield browser


@pytest.fixture
def place(tmp_path: Path) -> Place:
    """A store with a model of 14 objects, `toys:1`, and these objects, labelled, as the dataset `shelf`."""
    place = Place(tmp_path)
    place.store.publish(learnt(), name="toys", seed=5, source={"kind": "simulation"})
    datasets = Datasets(place.store.url)
    datasets.create("shelf")
    for number, simulated in enumerate(objects()):
        datasets.add("shelf", f"{number}.ply", write_ply(simulated.cloud))
    datasets.label("shelf", {f"{number}.ply": Label(category=f"kind {number % 2}") for number in range(14)})
    return place


@pytest.fixture
def host(place: Place) -> Iterator[str]:
    port = free_port()
    with place.api(port):
        yield f"http://127.0.0.1:{port}"


@pytest.fixture
def worker(place: Place) -> Iterator[None]:
    with place.worker("worker"):
        yield


@pytest.fixture
def visit(browser: Browser, host: str) -> Iterator[Visiting]:
    with ExitStack() as stack:

        def opening(shown: str, size: tuple[int, int] = DESKTOP, scheme: str = "light") -> Visit:
            visited = Visit(browser, host, size, scheme)
            stack.callback(visited.close)
            visited.open(shown)
            return visited

        yield opening


def told(host: str, path: str, **query: Any) -> Any:
    """What the service says without a browser."""
    return httpx.get(f"{host}/v1/{path}", params=query, timeout=60).raise_for_status().json()


def ply(number: int) -> bytes:
    return write_ply(objects()[number].cloud)


def drop(page: Page, files: dict[str, bytes]) -> None:
    """Drops files as a hand does that has dragged them from a folder."""
    sent = [[name, base64.b64encode(content).decode()] for name, content in files.items()]
    transfer = page.evaluate_handle(
        """(files) => {
            const transfer = new DataTransfer();
            for (const [name, content] of files) {
                transfer.items.add(new File([Uint8Array.from(atob(content), (c) => c.charCodeAt(0))], name));
            }
            return transfer;
        }""",
        sent,
    )
    page.dispatch_event(".drop", "dragover", {"dataTransfer": transfer})
    page.dispatch_event(".drop", "drop", {"dataTransfer": transfer})


def verdicts(page: Page) -> dict[str, str]:
    """What became of each file that was sent."""
    page.get_by_text("All is there.").wait_for()
    rows = page.locator(".verdicts tbody tr").all()
    return {row.locator("td").nth(0).inner_text(): row.locator("td").nth(1).inner_text() for row in rows}


def new_dataset(page: Page, name: str) -> None:
    page.get_by_label("Dataset", exact=True).select_option(label="A new dataset …")
    page.get_by_label("Name of the new dataset").fill(name)


def learn(page: Page, name: str, **choices: str) -> None:
    """Asks for a model learnt from the shelf alone."""
    page.get_by_label("Name of the model").fill(name)
    page.get_by_label("shelf", exact=True).check()
    page.get_by_label("simulated objects", exact=True).uncheck()
    for label, choice in choices.items():
        page.get_by_label(label.replace("_", " ")).select_option(choice)
    page.get_by_role("button", name="Submit").click()


def job(page: Page) -> Locator:
    return page.locator("article.job")


def state(page: Page, name: str) -> None:
    """Waits until the job that is shown is in a state."""
    job(page).locator(f".badge-{name}").wait_for(timeout=JOB)


def serving(page: Page) -> str:
    """The version that bears the alias production on the page."""
    return page.locator(".versions tr", has_text="production").locator("th a").inner_text()


def test_files_that_are_dropped_become_a_dataset_with_a_verdict_on_each(visit: Visiting, host: str) -> None:
    visited = visit("#/train")
    page = visited.page
    new_dataset(page, "kitchen")
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as packed:
        packed.writestr("deep/3.ply", ply(3))
    labels = "file,category\n0.ply,mug\nblåbær.ply,berry\n"
    drop(
        page,
        {
            "0.ply": ply(0),
            "blåbær.ply": ply(1),
            f"{'long' * 40}.ply": ply(2),
            "torn.ply": b"ply\n",
            "notes.md": b"# mugs",
            "more.zip": archive.getvalue(),
            "labels.csv": labels.encode(),
        },
    )
    assert verdicts(page) == {
        "0.ply": "taken",
        "blåbær.ply": "taken",
        f"{'long' * 40}.ply": "taken",
        "deep/3.ply": "taken",
        "labels.csv": "taken",
        "torn.ply": "refused",
        "notes.md": "left out",
    }
    assert "no header" in page.locator(".verdict-refused").inner_text()
    clouds = told(host, "datasets/kitchen/clouds")["clouds"]
    said = {cloud["key"]: cloud["label"] and cloud["label"]["category"] for cloud in clouds}
    assert said == {"0.ply": "mug", "blåbær.ply": "berry", "deep/3.ply": None, f"{'long' * 40}.ply": None}
    page.get_by_text("4 clouds,").wait_for()
    page.get_by_text("Its clouds", exact=True).click()
    page.get_by_role("cell", name="blåbær.ply").last.wait_for()
    drop(page, {"0.ply": ply(0), "torn.ply": ply(4)})
    page.get_by_text("1 taken, 1 already there").wait_for()
    visited.check()


def test_files_that_are_changed_or_gone_before_their_turn_are_refused_and_others_taken(
    visit: Visiting, tmp_path: Path
) -> None:
    visited = visit("#/train")
    page = visited.page
    new_dataset(page, "many")
    files = [tmp_path / f"{number}.ply" for number in range(26)]  # more than are sent together
    for number, file in enumerate(files):
        file.write_bytes(ply(number % 14))

    def change(route: Route) -> None:
        files[24].write_bytes(ply(3))
        route.continue_()

    page.route("**/many/archive*", change, times=1)
    page.set_input_files(".drop input:not([webkitdirectory])", files)
    told = verdicts(page)
    assert {file: verdict for file, verdict in told.items() if verdict != "taken"} == {"24.ply": "refused"}
    assert len(told) == 26
    page.get_by_text("changed or taken away since it was picked").wait_for()
    visited.check()


def test_what_is_dropped_while_files_are_being_sent_waits_for_its_turn(visit: Visiting, host: str) -> None:
    visited = visit("#/train?dataset=shelf")
    page = visited.page
    page.get_by_text("14 clouds,").wait_for()
    held: list[Route] = []
    page.route("**/shelf/archive*", lambda route: held.append(route))
    with page.expect_request("**/shelf/archive*"):
        drop(page, {"a.ply": ply(0)})
    drop(page, {"b.ply": ply(1)})
    page.locator(".drop").get_by_text("Files are being sent").wait_for()
    held[0].continue_()
    page.unroute("**/shelf/archive*")
    assert verdicts(page) == {"a.ply": "taken"}
    drop(page, {"b.ply": ply(1)})
    page.get_by_text("16 clouds,").wait_for()
    assert verdicts(page) == {"b.ply": "taken"}
    assert page.locator(".drop").get_by_role("alert").count() == 0
    visited.check()


@pytest.mark.usefixtures("worker")
def test_a_new_dataset_that_is_being_named_stays_so_when_a_job_makes_another_one(visit: Visiting) -> None:
    visited = visit("#/train")
    page = visited.page
    page.get_by_text("14 clouds,").wait_for()
    new_dataset(page, "kitchen")
    page.get_by_label("Simulate clouds").check()
    page.get_by_label("Objects", exact=True).fill("2")
    page.get_by_label("Renderer").select_option("raycast")
    page.get_by_role("button", name="Submit").click()
    state(page, "done")
    page.locator("select option[value=simulated]").first.wait_for(state="attached")
    page.wait_for_load_state("networkidle")
    assert page.get_by_label("Dataset", exact=True).input_value() == ""
    assert page.get_by_label("Name of the new dataset").input_value() == "kitchen"
    assert page.get_by_label("Name of the new dataset").is_visible()
    visited.check()


def test_a_folder_is_taken_with_its_paths_and_an_archive_larger_than_a_piece_in_pieces(
    visit: Visiting, host: str, tmp_path: Path
) -> None:
    folder = tmp_path / "scene"
    (folder / "near").mkdir(parents=True)
    (folder / "near" / "0.ply").write_bytes(ply(0))
    (folder / "near" / "labels.csv").write_text("file,category\n0.ply,mug\n")
    large = io.BytesIO()
    with zipfile.ZipFile(large, "w") as packed:
        for copy in range(80):
            packed.writestr(f"{copy}.xyz", "\n".join(["0.1 0.1 0.7", *_lines(copy)]))
    assert len(large.getvalue()) > 2 * 8 * 2**20  # bytes of two pieces
    visited = visit("#/train")
    page = visited.page
    new_dataset(page, "house")
    page.set_input_files(".drop input[webkitdirectory]", folder)
    assert verdicts(page) == {"scene/near/0.ply": "taken", "scene/near/labels.csv": "taken"}
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.method))
    (tmp_path / "large.zip").write_bytes(large.getvalue())
    page.set_input_files(".drop input:not([webkitdirectory])", tmp_path / "large.zip")
    page.get_by_text("80 taken").wait_for()
    assert asked.count("PATCH") == 3
    found = told(host, "datasets/house")
    assert (found["clouds"], found["categories"]) == (81, {"mug": 1})
    visited.check()


def _lines(copy: int) -> list[str]:
    points = objects()[copy % 14].cloud.points
    return [f"{x:.9f} {y:.9f} {z:.9f} {copy}" for x, y, z in points.tolist() * 2][:9000]


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
