"""Pictures as one HTML file that needs no other file, no network and no library: `respond --html`.

What draws clouds on the service's page draws them here: its modules are part of the file.
"""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Sequence
from importlib.resources import files
from string import Template
from typing import Any

import numpy as np
from numpy.typing import NDArray

from service.answer import Answer
from service.clouds import png
from service.pictures.colours import FIRST
from service.pictures.learnt import called, motif
from service.pictures.picture import CONCEPTS, Picture

_PARTS = {"style": "picture.css", "panels": "panels.js"}
_MODULES = ("cloud_view", "colours", "elements", "orbit", "splats")  # of the service's page
_LARGEST = 32_000  # steps from the middle: int16 holds 32,767


def write_html(pictures: Sequence[Picture]) -> str:
    """The page: a panel for each picture, to be turned, coloured and questioned."""
    page = files("service.pictures") / "page"
    data = {"pictures": [_told(picture) for picture in pictures], "colours": FIRST}
    # A file may be called "</script>": in JSON, all of these letters may be written as numbers.
    text = json.dumps(data).replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
    parts = {name: (page / file).read_text("utf-8") for name, file in _PARTS.items()}
    modules = json.dumps({"imports": {name: _module(name) for name in _MODULES}})
    return Template((page / "picture.html").read_text("utf-8")).substitute(parts, data=text, modules=modules)


def _module(name: str) -> str:
    """The address of a module, which is the module itself; others are imported by their names."""
    text = (files("service") / "web" / "parts" / f"{name}.js").read_text("utf-8")
    named = re.sub(r'from "\./(\w+)\.js"', r'from "\1"', text)
    return "data:text/javascript;base64," + base64.b64encode(named.encode()).decode()


def _told(picture: Picture) -> dict[str, Any]:
    low, high = picture.points.min(axis=0), picture.points.max(axis=0)
    step = max(float((high - low).max()) / 2 / _LARGEST, 1e-9)
    return {
        "title": picture.title,
        "notes": picture.notes,
        "of": picture.of,
        "step": step,
        "points": _packed(np.rint((picture.points - (low + high) / 2) / step), "<i2"),
        "segments": _packed(picture.segments, "<i2"),
        "colourings": [
            {
                "by": colouring.by,
                "values": _packed(colouring.values, "<u2"),
                "colours": colouring.colours,
                "labels": colouring.labels,
            }
            for colouring in picture.colourings
        ],
        "thumbnails": {
            number: "data:image/png;base64," + base64.b64encode(png.write(image)).decode()
            for number, image in picture.thumbnails.items()
        },
        "answer": picture.answer and _told_answer(picture, picture.answer),
    }


def _told_answer(picture: Picture, answer: Answer) -> dict[str, Any]:
    told = answer.model_dump(
        include={"model", "version", "time", "novelty", "segments", "extent_m", "timings_ms", "explanation"}
    )
    drawn = zip(answer.concepts[:CONCEPTS], picture.bars, picture.concept_colours, strict=False)
    listed = [
        concept.model_dump() | {"called": called(concept), "closeness": share, "colour": colour}
        for concept, share, colour in drawn
    ]
    fired = [motif(vertex) for vertex in answer.explanation.vertices] if answer.explanation else []
    return told | {"of": len(answer.responses), "concepts": listed, "motifs": fired}


def _packed(values: NDArray[Any], kind: str) -> str:
    return base64.b64encode(values.astype(kind).tobytes()).decode()
