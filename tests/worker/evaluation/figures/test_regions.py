"""The map with its ground, and the matrices."""

from __future__ import annotations

import base64
import re
from io import BytesIO

import numpy as np
from matplotlib.colors import to_rgb
from PIL import Image

from tests.worker.evaluation.figures.reports import LABELS, bare_report, response_map
from worker.evaluation.figures.palette import Palette
from worker.evaluation.figures.regions import MOST, STRONGEST, map_figure, matrix_figure

PALETTE = Palette(LABELS)


def test_a_cell_has_the_colour_of_its_label_and_is_the_stronger_the_more_neighbours_agree() -> None:
    shown = response_map()
    picture = map_figure(shown, PALETTE).panels[0].picture
    found = re.search(r'href="data:image/png;base64,([^"]*)"', picture)
    assert found is not None
    ground = np.asarray(Image.open(BytesIO(base64.b64decode(found[1]))).convert("RGBA")) / 255
    cells = np.array(shown.regions.cells)
    upside_down = re.search(r'transform="matrix\([\d.]+ 0 0 (-?)', picture)
    assert upside_down is not None
    ground = ground[::-1] if not upside_down[1] else ground
    assert ground.shape[:2] == cells.shape
    np.testing.assert_allclose(ground[:, :, 3], STRONGEST * np.array(shown.regions.opacity), atol=0.01)
    colours = np.array([to_rgb(PALETTE.mark(label).colour) for label in shown.regions.labels])
    np.testing.assert_allclose(ground[:, :, :3], colours[cells], atol=0.05)


def test_every_cloud_of_a_map_is_drawn() -> None:
    picture = map_figure(response_map(count=33), PALETTE).panels[0].picture
    assert len(re.findall(r"<use [^>]*>", picture)) == 33


def test_of_very_many_clouds_some_are_drawn_and_that_is_said() -> None:
    figure = map_figure(response_map(count=2 * MOST), PALETTE)
    assert len(re.findall(r"<use [^>]*>", figure.panels[0].picture)) == MOST
    assert f"of {2 * MOST} clouds" in figure.left_out


def test_matrices_show_their_numbers_and_their_diagonals_mean() -> None:
    report = bare_report()
    within, assigned = matrix_figure(report.matrices, report.figures).tables
    assert "mean of the diagonal 0.60" in within.heading
    assert "mean of the diagonal 0.50" in assigned.heading
    assert [row[0] for row in within.rows] == list(within.headings[1:]) == list(LABELS)
    np.testing.assert_allclose(np.array([row[1:] for row in within.rows], float), report.matrices.within, atol=0.005)
    assert within.shades == tuple(map(tuple, report.matrices.within))
