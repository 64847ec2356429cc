"""The page that `respond --html` writes: whole in itself, harmless, and drawn by a real browser."""

from __future__ import annotations

import base64
import io
import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image

from service.application import Application
from service.clouds import SceneCloud
from service.engine.cloud import PointCloud
from service.pictures.colours import parts
from service.pictures.html import write_html
from service.pictures.picture import Picture, draw_cloud
from tests.acceptance.browsing import DESKTOP, PHONE, Visit, chromium
from tests.acceptance.browsing import picture as shown
from tests.service.pictures.test_picture import learnt

if TYPE_CHECKING:
    from playwright.sync_api import Browser

DRAWN = """() => [...document.querySelectorAll("canvas")].every((canvas) => {
    const pixels = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
    return new Set(new Uint32Array(pixels.buffer)).size > 50;
})"""


@pytest.fixture
def picture(application: Application, clouds: list[PointCloud]) -> Picture:
    answer = application.respond(clouds[0], explain=True, segments=True)
    return draw_cloud(
        "mug.ply",
        SceneCloud(clouds[0]),
        answer,
        lambda told: learnt(application, told),
        lambda number: application.looking.thumbnail(answer.model, answer.version, number),
    )


def data(page: str) -> dict[str, Any]:
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    return json.loads(found[1])


def test_the_points_come_back_to_a_hundredth_of_their_distance(picture: Picture) -> None:
    (told,) = data(write_html([picture]))["pictures"]
    points = np.frombuffer(base64.b64decode(told["points"]), "<i2").reshape(-1, 3) * told["step"]
    middle = (picture.points.min(axis=0) + picture.points.max(axis=0)) / 2
    np.testing.assert_allclose(points, picture.points - middle, atol=0.01 * picture.spacing)
    assert np.frombuffer(base64.b64decode(told["segments"]), "<i2").tolist() == picture.segments.tolist()


def test_the_answer_is_told_as_it_is(picture: Picture) -> None:
    (told,) = data(write_html([picture]))["pictures"]
    answer = picture.answer
    assert answer is not None
    assert (told["answer"]["novelty"], told["answer"]["timings_ms"]) == (answer.novelty, answer.timings_ms)
    assert [each["id"] for each in told["answer"]["concepts"]] == [each.id for each in answer.concepts][:10]
    for number, url in told["thumbnails"].items():
        image = Image.open(io.BytesIO(base64.b64decode(url.removeprefix("data:image/png;base64,"))))
        np.testing.assert_array_equal(np.array(image), picture.thumbnails[int(number)])


def test_it_asks_for_nothing_from_anywhere(picture: Picture) -> None:
    page = write_html([picture])
    assert "default-src 'none'" in page
    assert not re.search(r"https?://|//cdn|@import|<link|<script src", page.replace("http://www.w3.org/2000/svg", ""))


def test_a_files_name_cannot_become_a_script(picture: Picture) -> None:
    hostile = "</script><script>document.title='taken'</script>&amp;.ply"
    renamed = Picture(**(vars(picture) | {"title": hostile}))
    page = write_html([renamed])
    assert page.lower().count("</script>") == 3
    assert data(page)["pictures"][0]["title"] == hostile


def count(file: Path, colour: tuple[int, ...]) -> int:
    """Pixels of a screenshot whose hue is that of a colour, however it is lit."""
    image = np.array(Image.open(file).convert("RGB")).astype(float)
    own = np.array(colour) / np.linalg.norm(colour)
    length = np.linalg.norm(image, axis=2)
    return int(((image @ own > 0.998 * length) & (length > 60)).sum())


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as browser:
        yield browser


@pytest.fixture
def visit(browser: Browser, picture: Picture, tmp_path: Path) -> Iterator[Callable[..., Visit]]:
    """Opens a page of two pictures; in the end the browser had nothing to complain about, nor asked for anything."""
    (tmp_path / "page.html").write_text(write_html([picture, picture]), encoding="utf-8")
    opened: list[Visit] = []

    def opening(size: tuple[int, int] = DESKTOP, scheme: str = "light") -> Visit:
        opened.append(Visit(browser, tmp_path.as_uri(), size, scheme))
        page = opened[-1].open("page.html")
        page.wait_for_function(DRAWN)
        return opened[-1]

    yield opening
    for one in opened:
        one.check()
        one.close()


@pytest.mark.slow
class TestInABrowser:
    """What a person sees and does."""

    @pytest.mark.parametrize("scheme", ["light", "dark"])
    def test_the_cloud_is_drawn_in_the_colours_of_its_segments(
        self, visit: Callable[..., Visit], picture: Picture, tmp_path: Path, scheme: str
    ) -> None:
        visit(scheme=scheme).page.screenshot(path=tmp_path / "shot.png")
        segments = picture.colourings[0]
        for place in np.unique(segments.values[picture.segments >= 0]).tolist():
            assert count(tmp_path / "shot.png", parts(segments.colours[place])) > 100, segments.labels[place]
        ground = np.array(Image.open(tmp_path / "shot.png").convert("L"))[-5, 5]
        assert (ground > 200) == (scheme == "light")

    def test_concepts_prototypes_motifs_and_stages_stand_beside_it(
        self, visit: Callable[..., Visit], picture: Picture
    ) -> None:
        answer = picture.answer
        assert answer is not None
        assert answer.explanation is not None
        page = visit().page
        panel = page.locator(".panel").first
        assert page.locator(".panel canvas").count() == 2
        named = panel.locator(".bars .name").all_inner_texts()
        assert named == [f"concept {concept.id}" for concept in answer.concepts[:10]]
        own = [concept for concept in answer.concepts[:10] if concept.time == answer.time]
        assert 0 < len(own) < 10
        assert panel.locator(".bars").first.locator(".name").count() == len(own)  # others stand apart
        for bars in panel.locator(".bars").all()[:2]:
            numbers = [float(text) for text in bars.locator("li > :last-child").all_inner_texts()]
            assert numbers == sorted(numbers)
        told = panel.locator(".thumbnails figure").last.inner_text()
        assert told.endswith(f", {answer.explanation.wholes[-1].distance:#.3g}")
        assert panel.locator(".motifs button").count() == len(answer.explanation.vertices)
        for stage, time in answer.timings_ms.items():
            assert panel.get_by_text(f"{stage} {time:.1f} ms", exact=True).count() == 1
        loaded = page.evaluate("[...document.images].every((image) => image.naturalWidth === 48)")
        assert (loaded, page.locator("img").count() > 10) == (True, True)

    def test_a_motif_that_is_chosen_pales_all_other_segments(
        self, visit: Callable[..., Visit], picture: Picture, tmp_path: Path
    ) -> None:
        answer = picture.answer
        assert answer is not None
        assert answer.explanation is not None
        covered = answer.explanation.vertices[0].segments
        others = [k for k in range(answer.segments) if k not in covered]
        assert others, "the object of this test has several segments"
        page = visit().page
        counts = []
        for name in ("before.png", "after.png"):
            page.locator("canvas").first.screenshot(path=tmp_path / name)
            own = (parts(picture.colourings[0].colours[k]) for k in (others[0], covered[0]))
            counts.append([count(tmp_path / name, colour) for colour in own])
            page.locator(".motifs button").first.click()
            page.wait_for_timeout(300)
        assert counts[1][0] < 0.5 * counts[0][0]
        assert counts[1][1] > 0.9 * counts[0][1]

    def test_the_cloud_is_coloured_and_turned_by_mouse_and_by_keys(self, visit: Callable[..., Visit]) -> None:
        page = visit().page
        seen = [shown(page, "canvas")]
        page.get_by_role("button", name="height").first.click()
        assert re.match(r"low\s*high, [0-9.]+ cm", page.locator(".legend").first.inner_text())
        page.wait_for_timeout(300)
        seen.append(shown(page, "canvas"))
        page.locator("canvas").first.focus()
        page.keyboard.press("ArrowRight")
        page.wait_for_timeout(300)
        seen.append(shown(page, "canvas"))
        assert len(set(seen)) == 3

    def test_on_a_phone_nothing_is_wider_than_the_screen(self, visit: Callable[..., Visit]) -> None:
        page = visit(size=PHONE).page
        assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
        cloud, concepts, motifs = (
            page.locator(chosen).first.bounding_box()["y"] for chosen in ("canvas", ".bars", ".motifs")
        )
        assert cloud < concepts < motifs
