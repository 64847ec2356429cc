"""Simulated clouds as files: PLY for any viewer, the truth about them as JSON, and a contact sheet."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable
from dataclasses import asdict
from io import BytesIO
from pathlib import Path
from typing import Any

from PIL import Image

from service.clouds import write_ply
from worker.simulation import SimulatedObject
from worker.simulation.contact_sheet import contact_sheet, draw_tile

COMPOSITIONS = "compositions.json"
CONTACT_SHEET = "contact-sheet.png"
OURS = re.compile(r"\.?(\d{4,}-order\d+\.ply|compositions\.json|contact-sheet\.png)(\.unfinished)?")
TILE = 128  # pixels
LARGEST_SHEET = 400  # objects that are drawn; more make a picture that nobody opens


def write(objects: Iterable[SimulatedObject], folder: Path) -> None:
    """Writes objects into a folder, which is made, in the place of what an earlier simulation wrote there.

    `0007-order3.ply` is the cloud of object 7; `compositions.json` tells for each file its prototypes and the camera's
    pose; `contact-sheet.png` shows the first 400. A file appears under its name when it is whole.

    Raises:
        OSError: the folder cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    _clear(folder)
    truth: dict[str, Any] = {}
    tiles: list[tuple[int, Image.Image]] = []
    for simulated in objects:
        name = f"{simulated.index:04}-order{simulated.order}.ply"
        _put(folder / name, write_ply(simulated.cloud))
        truth[name] = _truth(simulated)
        if len(tiles) < LARGEST_SHEET:
            tiles.append((simulated.order, draw_tile(simulated, TILE)))
    _put(folder / COMPOSITIONS, json.dumps(truth, indent=1).encode())
    if tiles:
        picture = BytesIO()
        contact_sheet(tiles).save(picture, "PNG", optimize=True)
        _put(folder / CONTACT_SHEET, picture.getvalue())


def _truth(simulated: SimulatedObject) -> dict[str, Any]:
    """Prototypes (metres; poses 4 x 4 in the composition's frame) and the composition's pose before the camera."""
    prototypes = [
        {"kind": p.kind, "dimensions": list(p.dimensions), "pose": p.pose.tolist()}
        for p in simulated.composition.prototypes
    ]
    view = {name: value.tolist() for name, value in asdict(simulated.view).items()}
    return {"order": simulated.order, "prototypes": prototypes, "view": view}


def _clear(folder: Path) -> None:
    """Removes what an earlier simulation wrote: left there, its clouds would pass for objects of this one."""
    for file in folder.iterdir():
        if OURS.fullmatch(file.name):
            file.unlink()


def _put(file: Path, data: bytes) -> None:
    """Writes a file under another name first, so that nothing half-written bears its own."""
    unfinished = file.with_name(f".{file.name}.unfinished")
    unfinished.write_bytes(data)
    os.replace(unfinished, file)
