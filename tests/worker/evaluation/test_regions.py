"""The map, its grid of regions, and the two matrices."""

from __future__ import annotations

import numpy as np
import pytest

from worker.evaluation.regions import CELLS, draw_response_map, lay_regions, region_matrices

LABELS = np.repeat(["ball", "box", "can"], 40)
PLACES = np.repeat([0, 1, 2], 40)


def blobs(distance: float) -> np.ndarray:
    centres = distance * np.array([[0, 0], [1, 0], [0, 1]])
    return (centres[PLACES] + np.random.default_rng(0).normal(size=(120, 2))).astype(np.float32)


def test_labels_that_lie_apart_have_regions_of_their_own() -> None:
    points = blobs(30)
    regions = lay_regions(points, PLACES, 3)
    assert (regions.of_points == PLACES).all()
    matrices = region_matrices([points], LABELS)
    assert matrices.labels == ("ball", "box", "can")
    assert matrices.within == pytest.approx(np.eye(3))
    assert matrices.assigned == pytest.approx(np.eye(3))


def test_the_first_row_is_at_the_lowest_y_and_the_first_column_at_the_lowest_x() -> None:
    cells = lay_regions(blobs(30), PLACES, 3).cells
    assert (cells[0, 0], cells[0, -1], cells[-1, 0]) == (0, 1, 2)


def test_opacity_is_the_share_of_the_neighbours_that_agree() -> None:
    regions = lay_regions(blobs(1), PLACES, 3)
    assert regions.neighbours == 6
    assert regions.opacity.shape == regions.cells.shape == (CELLS, CELLS)
    assert (regions.opacity * 6 == np.rint(regions.opacity * 6)).all()
    assert regions.opacity.min() >= 2 / 6  # of three labels one has a third at least
    assert lay_regions(blobs(1), 0 * PLACES, 1).opacity.min() == 1


def test_every_point_lies_in_the_cell_that_it_is_in() -> None:
    points = blobs(2)
    regions = lay_regions(points, PLACES, 3)
    step = (regions.high - regions.low) / CELLS
    for point, label in zip(points, regions.of_points, strict=True):
        column, row = np.minimum(((point - regions.low) / step).astype(int), CELLS - 1)
        assert regions.cells[row, column] == label


def test_rows_of_the_matrices_are_shares() -> None:
    matrices = region_matrices([blobs(1), blobs(2)], LABELS)
    assert matrices.assigned.sum(axis=1) == pytest.approx([1, 1, 1])
    assert (matrices.within >= 0).all()
    assert (matrices.within.sum(axis=1) <= 1 + 1e-12).all()


def test_a_map_keeps_together_what_is_together() -> None:
    vectors = 20 * np.eye(3)[PLACES] + np.random.default_rng(1).normal(size=(120, 3))
    points = draw_response_map(vectors, 0)
    assert points.shape == (120, 2)
    assert np.diag(region_matrices([points], LABELS).assigned).mean() > 0.95
    assert (points == draw_response_map(vectors, 0)).all()
