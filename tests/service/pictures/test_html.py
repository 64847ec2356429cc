"""The page that `respond --html` writes: whole in itself, harmless, and drawn by a real browser."""

from __future__ import annotations

import base64
import io
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from service.application import Application
from service.clouds import SceneCloud
from service.engine.cloud import PointCloud
from service.pictures.colours import parts
from service.pictures.html import write_html
from service.pictures.picture import Picture, draw_cloud
from tests.service.pictures.test_picture import learnt

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")


@pytest.fixture
def picture(application: Application, clouds: list[PointCloud]) -> Picture:
    answer = application.respond(clouds[0], explain=True, segments=True)
    return draw_cloud(
        "mug.ply",
        SceneCloud(clouds[0]),
        answer,
        lambda told: learnt(application, told),
        lambda number: application.thumbnail(answer.model, answer.version, number),
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
    assert not re.search(r"https?://|//cdn|@import|<link|<script src", page)


def test_a_files_name_cannot_become_a_script(picture: Picture) -> None:
    hostile = "</script><script>document.title='taken'</script>&amp;.ply"
    renamed = Picture(**(vars(picture) | {"title": hostile}))
    page = write_html([renamed])
    assert page.lower().count("</script>") == 2
    assert data(page)["pictures"][0]["title"] == hostile


def browse(page: str, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Opens a page in Chromium, without a network to speak of."""
    file = folder / "page.html"
    file.write_text(page, encoding="utf-8")
    assert CHROMIUM is not None
    command = [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--window-size=1280,1400"]
    command += ["--virtual-time-budget=3000", "--proxy-server=127.0.0.1:9", f"--user-data-dir={folder / 'profile'}"]
    return subprocess.run(
        [*command, *arguments, file.as_uri()], check=True, capture_output=True, text=True, timeout=120
    )


def count(file: Path, colour: tuple[int, ...]) -> int:
    """Pixels of a screenshot whose hue is that of a colour, however dark they are."""
    image = np.array(Image.open(file).convert("RGB")).astype(float)
    own = np.array(colour) / np.linalg.norm(colour)
    length = np.linalg.norm(image, axis=2)
    return int(((image @ own > 0.999 * length) & (length > 60)).sum())


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed")
class TestInABrowser:
    """What a person sees."""

    def test_the_cloud_is_drawn_in_the_colours_of_its_segments_by_day_and_by_night(
        self, picture: Picture, tmp_path: Path
    ) -> None:
        segments = picture.colourings[0]
        shown = np.unique(segments.values[picture.segments >= 0])
        for scheme in ("1", "0"):  # light, dark
            shot = tmp_path / f"{scheme}.png"
            browse(
                write_html([picture]),
                tmp_path,
                f"--blink-settings=preferredColorScheme={scheme}",
                f"--screenshot={shot}",
            )
            for place in shown.tolist():
                assert count(shot, parts(segments.colours[place])) > 100, segments.labels[place]
            ground = np.array(Image.open(shot).convert("L"))[-5, 5]
            assert (ground > 200) == (scheme == "1")

    def test_concepts_prototypes_motifs_and_stages_stand_beside_it(self, picture: Picture, tmp_path: Path) -> None:
        answer = picture.answer
        assert answer is not None
        assert answer.explanation is not None
        dom = browse(write_html([picture, picture]), tmp_path, "--dump-dom").stdout
        assert dom.count('class="motifs"') == dom.count("<canvas") == 2
        for concept in answer.concepts[:10]:
            assert f"concept {concept.id}</span>" in dom
        assert dom.count('aria-pressed="false"') >= 2 * len(answer.explanation.vertices)
        for stage, time in answer.timings_ms.items():
            assert f"{stage} {time:.1f} ms" in dom
        assert "noscript" not in dom.partition('id="pictures"')[2].partition("</main>")[0]

    def test_a_motif_that_is_chosen_pales_all_other_segments(self, picture: Picture, tmp_path: Path) -> None:
        answer = picture.answer
        assert answer is not None
        assert answer.explanation is not None
        covered = answer.explanation.vertices[0].segments
        others = [k for k in range(answer.segments) if k not in covered]
        assert others, "the object of this test has several segments"
        choose = "<script>document.querySelector('.motifs button').click()</script></body>"
        counts = []
        for page in (write_html([picture]), write_html([picture]).replace("</body>", choose)):
            browse(page, tmp_path, f"--screenshot={tmp_path / 'shot.png'}")
            counts.append(
                [count(tmp_path / "shot.png", parts(picture.colourings[0].colours[k])) for k in (others[0], covered[0])]
            )
        assert counts[1][0] < 0.5 * counts[0][0]
        assert counts[1][1] > 0.9 * counts[0][1]

    def test_the_colours_can_be_changed(self, picture: Picture, tmp_path: Path) -> None:
        height = "[...document.querySelectorAll('button')].find((button) => button.textContent === 'height')"
        choose = f"<script>{height}.click()</script></body>"
        dom = browse(write_html([picture]).replace("</body>", choose), tmp_path, "--dump-dom").stdout
        assert re.search(r'aria-pressed="true">height', dom)
        assert re.search(r"low<i [^>]*></i>high, [0-9.]+ cm", dom)
