"""The connected pieces over a plane, and which of them are objects that stand on it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError, cKDTree

from service.tabletop.records import Box, Plane, TabletopParams

NEAREST = 9  # voxels of the ground that are looked for under a piece
SEEN_UNDER = 0.5  # share of them under it that tells that it floats


def connect(points: NDArray[np.float64], gap: float) -> list[NDArray[np.int64]]:
    """The pieces of points (N, 3), each the ascending rows of points less than `gap` from one another (Rusu 2009)."""
    if not len(points):
        return []
    pairs = cKDTree(points).query_pairs(gap, output_type="ndarray").astype(np.int32)
    links = coo_array((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(len(points),) * 2)
    piece = connected_components(links, directed=False)[1]
    order = np.argsort(piece, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(piece[order])) + 1)


def judge(points: NDArray[np.float64], ground: cKDTree, plane: Plane, params: TabletopParams) -> str:
    """Why a piece is no object: a reason; "" if it is one.

    Args:
        points: (V, 3) of the piece's voxels, metres.
        ground: where along the plane its own voxels are, metres. A piece of which no foot is seen stands on the plane
            all the same where the ground under it is not seen either: something may hide both.
        plane: that may bear it.
        params: what is taken for an object.
    """
    heights = plane.heights(points)
    if heights.max() < params.min_rise or np.linalg.norm(np.ptp(points, axis=0)) < params.min_extent:
        return "small"
    if heights.min() > params.foot and _share_under(points @ plane.basis.T, ground) > SEEN_UNDER:
        return "afloat"
    longest = stand_box(points, plane).size.max()
    if longest < params.min_extent:
        return "small"
    return "large" if longest > params.max_extent else ""


def stand_box(points: NDArray[np.float64], plane: Plane) -> Box:
    """The box of least ground that holds points (N, 3) and stands upright on a plane."""
    flat = points @ plane.basis.T
    heights = plane.heights(points)
    along = _direction(flat)
    across = np.array([-along[1], along[0]])
    sizes = np.array([np.ptp(flat @ along), np.ptp(flat @ across), np.ptp(heights)])
    if sizes[1] > sizes[0]:
        along, across = across, -along
        sizes[:2] = sizes[1::-1]
    axes = np.stack([along @ plane.basis, across @ plane.basis, plane.normal])
    placed = points @ axes.T
    return Box((placed.max(axis=0) + placed.min(axis=0)) / 2 @ axes, axes, sizes)


def _direction(flat: NDArray[np.float64]) -> NDArray[np.float64]:
    """The direction (2,) of a side of the rectangle of least area around points (N, 2): that of a side of the hull."""
    outline = _outline(flat)
    if outline is None:
        spread = flat - flat.mean(axis=0)
        return np.linalg.eigh(spread.T @ spread)[1][:, 1]
    edges = outline.equations[:, :2]
    areas = [np.ptp(flat @ n) * np.ptp(flat @ np.array([-n[1], n[0]])) for n in edges]
    return edges[int(np.argmin(areas))]


def _outline(flat: NDArray[np.float64]) -> ConvexHull | None:
    try:
        return ConvexHull(flat)
    except QhullError:  # fewer than 3 points, or all on one line
        return None


def _share_under(flat: NDArray[np.float64], ground: cKDTree) -> float:
    """Share of the ground that is nearest to a piece's middle that is within its outline; 0 if it has none."""
    outline = _outline(flat)
    if outline is None:
        return 0.0
    nearest = ground.query(outline.points.mean(axis=0), min(NEAREST, ground.n))[1]
    return _share_within(ground.data[np.atleast_1d(nearest)], outline)


def _share_within(flat: NDArray[np.float64], outline: ConvexHull) -> float:
    inside = np.ones(len(flat), bool)
    for x, y, beyond in outline.equations:
        inside &= flat[:, 0] * x + flat[:, 1] * y + beyond <= 0
    return float(inside.mean())
