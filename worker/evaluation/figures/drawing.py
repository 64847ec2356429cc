"""From something drawn with matplotlib to SVG that stands in a page: the same bytes for the same picture."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from io import StringIO
from typing import Any

from markupsafe import Markup, escape
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from worker.evaluation.figures.palette import INK, PAGE_COLOURS, PALE

WIDTH = 360  # of a picture, CSS pixels: that of a phone, where text keeps its size; wider pages draw it larger
STYLE: dict[Any, Any] = {
    "axes.axisbelow": True,
    "axes.edgecolor": PALE,
    "axes.facecolor": "none",
    "axes.grid": True,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.8,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "figure.dpi": 72,  # a point is a pixel
    "figure.facecolor": "none",
    "font.size": 12,
    "grid.alpha": 0.35,
    "grid.color": PALE,
    "grid.linewidth": 0.6,
    "hatch.color": INK,
    "hatch.linewidth": 0.6,
    "svg.fonttype": "none",  # text stays text: it can be read aloud, searched and copied
    "text.color": INK,
    "text.parse_math": False,  # a label may hold a $
    "xtick.color": INK,
    "xtick.labelsize": 11,
    "ytick.color": INK,
    "ytick.labelsize": 11,
}
NOTHING = {"Creator": None, "Date": None, "Format": None, "Type": None}  # of the metadata: no time, no version
PREFIXED = re.compile(r'(\bid="|url\(#|href="#)')
BEFORE = re.compile(r'^.*?<svg [^>]*?(viewBox="[^"]*")[^>]*>', re.DOTALL)
COORDINATES = re.compile(r'(?<= [dxy]=")[^"]*')
FINER = re.compile(r"(\.\d\d)\d+")  # than a hundredth of a pixel
LEAKING = re.compile(r"<style type=.text/css.>.*?</style>", re.DOTALL)  # would hold for the whole page


def draw(key: str, alt: str, height: float, paint: Callable[[Axes], None], *, frame: bool = True) -> Markup:
    """An SVG picture that a page can hold among others.

    Args:
        key: that no other picture of the page has.
        alt: what the picture shows, for those who cannot see it.
        height: CSS pixels, where the width is 360.
        paint: draws into axes.
        frame: whether there are axes to be seen; without, the whole picture is drawn into.
    """
    written = StringIO()
    with rc_context({**STYLE, "svg.hashsalt": key}), warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of letters that only the reader's fonts have
        canvas = Canvas(figsize=(WIDTH / 72, height / 72), layout="constrained" if frame else None)
        axes = canvas.add_subplot() if frame else canvas.add_axes((0, 0, 1, 1))
        if not frame:
            axes.set_axis_off()
        paint(axes)
        canvas.savefig(written, format="svg", metadata=NOTHING)
    return _for_page(written.getvalue(), key, alt)


def _for_page(svg: str, key: str, alt: str) -> Markup:
    head = f'<svg xmlns:xlink="http://www.w3.org/1999/xlink" \\1 role="img" aria-label="{_replacement(escape(alt))}">'
    svg = PREFIXED.sub(lambda found: f"{found[1]}{key}-", LEAKING.sub("", BEFORE.sub(head, svg, count=1)))
    svg = COORDINATES.sub(lambda found: FINER.sub(r"\1", found[0]), svg)
    for stand_in, colour in PAGE_COLOURS.items():
        svg = svg.replace(stand_in, colour)
    return Markup(svg)


def _replacement(text: str) -> str:
    """A text that means itself where a pattern is replaced by it."""
    return str(text).replace("\\", "\\\\")


def shortened(text: str, most: int) -> str:
    """A text of at most so many characters, on one line."""
    line = " ".join(text.split())
    return line if len(line) <= most else line[: most - 1] + "…"
