"""One picture of many simulated clouds: each point a small disc, shaded by the surface it was measured on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from worker.simulation.compositions import KINDS
from worker.simulation.params import CameraParams

if TYPE_CHECKING:
    from worker.simulation import SimulatedObject

# The paper's colours, (0, 0, 240), (0, 240, 0) and (240, 240, 0), softened.
COLOURS = {"box": (74, 105, 214), "cylinder": (76, 178, 96), "sphere": (240, 200, 62)}
BACKGROUND = (246, 246, 243)
INK, PALE_INK, RULE = (70, 74, 82), (130, 134, 142), (222, 222, 218)
LIGHT = np.array([-0.45, -0.75, -0.55]) / np.linalg.norm([0.45, 0.75, 0.55])  # from the upper left, before the object
SHARPNESS = 2  # pixels drawn for one pixel of the picture, along each axis
MARGIN = 0.08  # share of a tile that stays empty on each side
LANDSCAPE = 1.9  # columns for each row
LEAST_COLUMNS = 3  # as wide as the legend


def draw_tile(simulated: SimulatedObject, size: int) -> Image.Image:
    """One object as its sensor saw it, filling a square of `size` pixels."""
    canvas = size * SHARPNESS
    points = simulated.cloud.points.astype(np.float64)
    colours = _shaded(simulated)
    place = points[:, :2] / points[:, 2:]
    low, high = place.min(axis=0), place.max(axis=0)
    scale = canvas * (1 - 2 * MARGIN) / max(np.max(high - low), 1e-6)
    place = (place - (low + high) / 2) * scale + canvas / 2
    # A disc reaches half way into the diagonal neighbours, and over the rounding to pixels, so that the surface closes.
    radius = 0.75 * scale / CameraParams().focal + 0.7
    image = np.empty((canvas, canvas, 3), dtype=np.uint8)
    image[:] = BACKGROUND
    _splat(image, place, points[:, 2], colours, radius)
    return Image.fromarray(image).resize((size, size), Image.Resampling.LANCZOS)


def contact_sheet(tiles: Sequence[tuple[int, Image.Image]]) -> Image.Image:
    """Arranges tiles in rows, those of each prototype order together.

    Args:
        tiles: the order of each object, and its tile; at least one, all of one size.
    """
    by_order: dict[int, list[Image.Image]] = {order: [] for order in sorted({order for order, _ in tiles})}
    for order, image in tiles:
        by_order[order].append(image)
    columns = _columns([len(images) for images in by_order.values()])
    rows = [
        (order, images[first : first + columns])
        for order, images in by_order.items()
        for first in range(0, len(images), columns)
    ]
    size = tiles[0][1].width
    left, top, end = round(0.55 * size), round(0.3 * size), size // 8
    sheet = Image.new("RGB", (left + columns * size + end, top + len(rows) * size + end), BACKGROUND)
    draw = ImageDraw.Draw(sheet)
    for row, (order, images) in enumerate(rows):
        y = top + row * size
        for column, image in enumerate(images):
            sheet.paste(image, (left + column * size, y))
        if row == 0 or rows[row - 1][0] != order:
            _label(draw, left, y, size, order)
            draw.line([(size // 8, y), (sheet.width - size // 8, y)], fill=RULE)
    _legend(draw, sheet.width, top)
    return sheet


def _columns(lengths: Sequence[int]) -> int:
    """Tiles in a row, so that no row is nearly empty and the sheet is about twice as wide as high."""
    longest = max(lengths)
    rows_each = max(1, round(math.sqrt(longest / (LANDSCAPE * len(lengths)))))
    return max(LEAST_COLUMNS, math.ceil(longest / rows_each))


def _shaded(simulated: SimulatedObject) -> NDArray[np.uint8]:
    """(N, 3) colour of each point: its prototype's kind under a light from above, darker where it turns away."""
    points = simulated.cloud.points.astype(np.float64)
    rotation = simulated.view.pose[:3, :3]
    labels = simulated.labels.astype(np.int64)
    normals = simulated.composition.normals(simulated.view.to_composition(points), labels) @ rotation
    sight = points / np.linalg.norm(points, axis=1, keepdims=True)
    diffuse = np.clip(normals @ LIGHT, 0, 1)
    facing = np.clip(-np.einsum("ij,ij->i", normals, sight), 0, 1)
    halfway = (LIGHT - sight) / np.linalg.norm(LIGHT - sight, axis=1, keepdims=True)
    gloss = np.clip(np.einsum("ij,ij->i", normals, halfway), 0, 1) ** 40
    kinds = np.array([KINDS.index(prototype.kind) for prototype in simulated.composition.prototypes])
    base = np.array([COLOURS[kind] for kind in KINDS])[kinds[labels]]
    bright = (0.62 + 0.46 * diffuse) * (0.72 + 0.28 * facing)
    colour = base * bright[:, None] + 255 * 0.2 * gloss[:, None]
    return np.clip(colour, 0, 255).astype(np.uint8)


def _splat(
    image: NDArray[np.uint8],
    place: NDArray[np.float64],
    depth: NDArray[np.float64],
    colours: NDArray[np.uint8],
    radius: float,
) -> None:
    """Draws a disc for each point into the image (H, W, 3), the near ones over the far ones."""
    height, width = image.shape[:2]
    reach = int(np.ceil(radius))
    dy, dx = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    disc = dx**2 + dy**2 <= radius**2
    far_first = np.argsort(-depth, kind="stable")
    x, y = np.rint(place[far_first]).astype(np.int64).T
    columns = np.clip(x[:, None] + dx[disc], 0, width - 1)
    rows = np.clip(y[:, None] + dy[disc], 0, height - 1)
    # Of several points that fall on one pixel, the last, which is the nearest, stays.
    image[rows.ravel(), columns.ravel()] = np.repeat(colours[far_first], disc.sum(), axis=0)


def _label(draw: ImageDraw.ImageDraw, left: int, y: int, size: int, order: int) -> None:
    draw.text((left // 2, y + size * 0.5), str(order), font=ImageFont.load_default(size * 0.26), fill=INK, anchor="mm")
    name = "prototype" if order == 1 else "prototypes"
    draw.text((left // 2, y + size * 0.68), name, font=ImageFont.load_default(size * 0.085), fill=PALE_INK, anchor="mm")


def _legend(draw: ImageDraw.ImageDraw, right: int, height: int) -> None:
    font = ImageFont.load_default(height * 0.3)
    x = right - height * 0.5
    for kind in reversed(KINDS):
        x -= draw.textlength(kind, font=font)
        draw.text((x, height * 0.55), kind, font=font, fill=INK, anchor="lm")
        x -= height * 0.5
        dot = height * 0.13
        draw.ellipse([(x - dot, height * 0.55 - dot), (x + dot, height * 0.55 + dot)], fill=COLOURS[kind])
        x -= height * 0.5
