"""Where a scene's voxels lie about a plane: in it, over it, beside or behind it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label
from scipy.spatial import ConvexHull, QhullError

from service.tabletop.records import Plane, TabletopParams
from service.tabletop.voxels import Voxels

CELL = 0.03  # metres: parts of the plane less far apart are one, as what stands on it hides some of it
FLAT = 10  # times half the thickness of its layer that a plane is wide at least: any blob lies in a thick one
MIN_PART = 0.05  # share of the plane's voxels; smaller parts lie in it by chance
PLANE, OVER, BELOW, HIGH, BESIDE = "plane", "over", "below", "high", "beside"


def layer(voxels: Voxels, plane: Plane, params: TabletopParams) -> NDArray[np.str_] | None:
    """PLANE, OVER, BELOW, HIGH or BESIDE for each voxel (V,); None if the plane is too narrow, or thick, for a table.

    Over the plane is what lies above the convex hull of its large parts.
    """
    heights = plane.heights(voxels.points)
    flat = voxels.points @ plane.basis.T  # (V, 2)
    in_plane = np.abs(heights) <= plane.band
    hull = _hull(flat[in_plane], max(CELL, 2 * voxels.size))
    narrowest = max(params.min_width, FLAT * plane.band)
    if hull is None or min(np.ptp(hull.points @ edge[:2]) for edge in hull.equations) < narrowest:
        return None
    over = np.ones(len(flat), bool)
    for x, y, beyond in hull.equations:
        over &= flat[:, 0] * x + flat[:, 1] * y + beyond <= params.margin
    layers = np.where(over, OVER, BESIDE)
    layers[heights > params.max_height] = HIGH
    layers[heights < -plane.band] = BELOW
    layers[in_plane] = PLANE
    return layers


def _hull(flat: NDArray[np.float64], cell: float) -> ConvexHull | None:
    """Of a plane's points (N, 2), metres, without its small parts; None if they are all small, or on one line."""
    cells = np.floor((flat - flat.min(axis=0)) / cell).astype(np.int64)
    grid = np.zeros(cells.max(axis=0) + 1, bool)
    grid[tuple(cells.T)] = True
    part = label(grid, np.ones((3, 3)))[0][tuple(cells.T)]
    large = flat[np.bincount(part)[part] >= MIN_PART * len(flat)]
    try:
        return ConvexHull(large) if len(large) else None
    except QhullError:
        return None
