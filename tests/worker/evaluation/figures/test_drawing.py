"""Pictures that stand in a page among others."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree

from matplotlib.axes import Axes

from worker.evaluation.figures.drawing import draw, shortened
from worker.evaluation.figures.palette import INK


def paint(axes: Axes) -> None:
    axes.plot([0, 1], [1, 0], color=INK, marker="o")
    axes.set_xlabel("price in $ & <b>£</b> of $x^2$")


def test_the_same_picture_has_the_same_bytes() -> None:
    assert draw("one", "a line", 200, paint) == draw("one", "a line", 200, paint)


def test_a_picture_says_what_it_shows_whatever_that_holds() -> None:
    alt = 'a "line" \\1 <script> & more'
    picture = ElementTree.fromstring(draw("one", alt, 200, paint))
    assert picture.get("aria-label") == alt
    assert picture.get("role") == "img"


def test_text_stays_text() -> None:
    words = "".join(ElementTree.fromstring(draw("one", "a line", 200, paint)).itertext())
    assert "price in $ & <b>£</b> of $x^2$" in words


def test_pictures_share_no_names_and_find_their_own() -> None:
    names = []
    for key in ("one", "two"):
        picture = draw(key, "a line", 200, paint)
        own = re.findall(r'\bid="([^"]*)"', picture)
        assert len(set(own)) == len(own)
        assert set(re.findall(r'href="#([^"]*)"|url\(#([^)]*)\)', picture)) <= {
            pair for name in own for pair in ((name, ""), ("", name))
        }
        names.append(set(own))
    assert not names[0] & names[1]


def test_lines_have_the_page_s_own_colours() -> None:
    picture = draw("one", "a line", 200, paint)
    assert "var(--ink)" in picture
    assert INK not in picture


def test_nothing_leaks_into_the_page() -> None:
    picture = draw("one", "a line", 200, paint)
    assert "<style" not in picture
    assert "<?xml" not in picture
    assert "<!DOCTYPE" not in picture
    assert "<metadata" not in picture


def test_a_short_text_stays_whole_and_a_long_one_says_that_it_goes_on() -> None:
    assert shortened("a  box\n", 5) == "a box"
    assert shortened("a wooden box", 8) == "a woode…"
