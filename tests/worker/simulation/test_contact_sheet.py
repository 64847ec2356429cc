from __future__ import annotations

from io import BytesIO

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from service.engine.cloud import PointCloud
from tests.shapes import ball, box, can, cube, look, see, stack
from worker.simulation import SimulatedObject
from worker.simulation.compositions import Composition
from worker.simulation.contact_sheet import BACKGROUND, COLOURS, contact_sheet, draw_tile

SIZE = 96
SOLIDS = {"box": cube(0.15), "cylinder": can(0.07, 0.18), "sphere": ball(0.1)}


def simulated(solid: Composition) -> SimulatedObject:
    view = look(30, 30, 1.0)
    seen = see(solid, view, "kinect")
    return SimulatedObject(0, seen.cloud, solid, view, seen.labels, seen.faces)


def pixels(image: Image.Image) -> NDArray[np.int64]:
    return np.asarray(image.convert("RGB")).astype(np.int64)


@pytest.mark.parametrize("kind", SOLIDS)
def test_a_tile_shows_the_object_in_the_colour_of_its_kind(kind: str) -> None:
    tile = pixels(draw_tile(simulated(SOLIDS[kind]), SIZE))
    assert tile.shape == (SIZE, SIZE, 3)
    drawn = np.abs(tile - BACKGROUND).max(axis=2) > 40
    assert 0.25 < drawn.mean() < 0.95
    assert not drawn[[0, -1]].any()
    assert not drawn[:, [0, -1]].any()
    # Light and shade change how bright a colour is, hardly which it is.
    hue = tile[drawn].mean(axis=0)
    nearest = min(COLOURS, key=lambda k: -np.dot(hue, COLOURS[k]) / np.linalg.norm(COLOURS[k]))
    assert nearest == kind


def test_the_sides_of_a_box_are_told_apart_by_their_shade() -> None:
    one = simulated(SOLIDS["box"])
    tile = pixels(draw_tile(one, SIZE)).sum(axis=2)
    x, y = (one.cloud.points[:, :2] / one.cloud.points[:, 2:]).T
    columns, rows = ((v - (v.min() + v.max()) / 2) for v in (x, y))
    scale = SIZE * 0.84 / max(np.ptp(x), np.ptp(y))
    shades = []
    for face in np.unique(one.faces):
        mine = one.faces == face
        if mine.sum() > 500:
            at = np.rint(np.array([rows[mine].mean(), columns[mine].mean()]) * scale + SIZE / 2).astype(int)
            shades.append(tile[tuple(at)])
    assert len(shades) == 3
    assert min(abs(a - b) for i, a in enumerate(shades) for b in shades[:i]) > 15


def test_what_is_nearer_hides_what_is_farther() -> None:
    solid, view = stack((ball(0.1), (0, 0, 0)), (box(0.08, 0.08, 0.02), (0, 0, 0.3))), look(0, 90, 1.2)
    seen = see(solid, view)
    # The ball's points once more, all of them, and last: the camera's own order must not decide.
    far = see(ball(0.1), view)
    cloud = PointCloud(np.concatenate([seen.cloud.points, far.cloud.points]))
    labels, faces = (np.concatenate([a, b]) for a, b in ((seen.labels, far.labels), (seen.faces, far.faces)))
    tile = pixels(draw_tile(SimulatedObject(0, cloud, solid, view, labels, faces), SIZE))
    red, _, blue = tile[SIZE // 2, SIZE // 2]
    assert blue > red, "the middle shows the ball, not the box before it"


def test_a_sheet_has_a_row_or_more_for_each_order_from_above() -> None:
    counts = {1: 9, 2: 1, 3: 5}
    plain = [
        (order, Image.new("RGB", (SIZE, SIZE), (10 * order, 0, 200)))
        for order in (3, 1, 2)
        for _ in range(counts[order])
    ]
    sheet = contact_sheet(plain)
    shown = pixels(sheet)
    last = 0
    for order, count in counts.items():
        of_order = (shown == (10 * order, 0, 200)).all(axis=2)
        # A hairline between orders covers a little of the tiles.
        assert of_order.sum() == pytest.approx(count * SIZE**2, rel=0.03), "a tile is hidden or cut off"
        rows = np.flatnonzero(of_order.any(axis=1))
        assert rows.min() > last
        last = rows.max()
    assert sheet.height < len(plain) * SIZE


@pytest.mark.parametrize("count", [1, 8, 50, 80])
def test_a_sheet_is_neither_a_ribbon_nor_a_tower(count: int) -> None:
    tile = Image.new("RGB", (SIZE, SIZE))
    sheet = contact_sheet([(order, tile) for order in range(1, 6) for _ in range(count)])
    assert 0.5 < sheet.width / sheet.height < 3
    assert 5 * count * SIZE**2 / (sheet.width * sheet.height) > 0.2, "mostly empty"


def test_a_sheet_names_the_orders_and_the_kinds() -> None:
    blank = Image.new("RGB", (SIZE, SIZE), BACKGROUND)
    sheet = contact_sheet([(1, blank), (2, blank)])
    shown = np.abs(pixels(sheet) - BACKGROUND).max(axis=2) > 40
    assert shown[:, : SIZE // 2].any(), "orders on the left"
    assert shown[: SIZE // 4].any(), "kinds above"


def test_a_sheet_is_a_png_of_its_size() -> None:
    sheet = contact_sheet([(1, draw_tile(simulated(solid), SIZE)) for solid in SOLIDS.values()])
    written = BytesIO()
    sheet.save(written, "PNG")
    with Image.open(BytesIO(written.getvalue())) as read:
        assert (read.format, read.size) == ("PNG", sheet.size)
        assert np.array_equal(pixels(read), pixels(sheet))
