"""Train in a real browser: files dropped, with a verdict on each."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.acceptance.page.train.using import drop, new_dataset, ply, state, told, verdicts
from tests.acceptance.page.visiting import Visiting
from tests.learnt import objects

if TYPE_CHECKING:
    from playwright.sync_api import Route

pytestmark = pytest.mark.slow


def _lines(copy: int) -> list[str]:
    points = objects()[copy % 14].cloud.points
    return [f"{x:.9f} {y:.9f} {z:.9f} {copy}" for x, y, z in points.tolist() * 2][:9000]


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
