"""Distributions over random points that see how a constellation's parts are arranged.

After Osada et al., "Shape Distributions", ACM TOG 2002; beside them the angles between normals and the convexity of
pairs.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from service.engine.angles import turn

SHAPE_BINS = 24  # of each of the five distributions
SHAPES = 5
DISTANCE_RANGE = 4.0  # pair distances, rms radii
AREA_RANGE = 2.0  # square roots of triangle areas, rms radii
CHUNK = 256  # triples that are measured together: as many as the nearest cache holds


def shape_distributions(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    labels: NDArray[np.int64],
    members: NDArray[np.bool_],
    draws: int,
) -> NDArray[np.float64]:
    """Five histograms of each constellation (C, 120), together summing to 1.

    Distance and square root of the triangle's area (both over the constellation's rms radius), angle at a point, angle
    between two normals, signed convexity of two normals against the joining line.

    Args:
        points: (M, 3).
        normals: (M, 3), unit length.
        labels: (M,): the segment of each point.
        members: (C, S): which segments are united in each constellation, at least one.
        draws: random triples of points for a constellation.
    """
    out = np.empty((len(members), SHAPES * SHAPE_BINS))
    for constellation, segments in enumerate(members):
        own = np.flatnonzero(segments[labels])
        out[constellation] = _distributions(points, normals, own, _triples(draws))
    return out


@cache
def _triples(draws: int) -> NDArray[np.float64]:
    """Uniform in [0, 1) (3, T), the same for all: part of the descriptor. They pick points by their place."""
    return np.ascontiguousarray(np.random.default_rng(0).random((draws, 3)).T)


@njit(cache=True, nogil=True, error_model="numpy")
def _distributions(
    points: NDArray[np.float64], normals: NDArray[np.float64], own: NDArray[np.int64], triples: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The five histograms of the points `own`."""
    per_rms = 1 / max(_rms_radius(points, own), 1e-9)
    out = np.zeros(SHAPES * SHAPE_BINS)
    corners, places = np.empty((12, CHUNK)), np.empty((SHAPES, CHUNK))
    filled = 0
    for t in range(triples.shape[1]):
        i, j, k = int(triples[0, t] * len(own)), int(triples[1, t] * len(own)), int(triples[2, t] * len(own))
        if i in (j, k) or j == k:
            continue
        filled += _triple(points, normals, own[i], own[j], own[k], corners, filled)
        if filled == CHUNK:
            _measure(corners, places, per_rms)
            _vote(places, filled, out)
            filled = 0
    corners[:, filled:] = 1.0
    _measure(corners, places, per_rms)
    _vote(places, filled, out)
    total = out.sum()
    return out / total if total > 0 else np.full(len(out), 1.0 / len(out))


@njit(cache=True, nogil=True, error_model="numpy")
def _rms_radius(points: NDArray[np.float64], own: NDArray[np.int64]) -> float:
    """Of some points about their mean."""
    x, y, z, square = 0.0, 0.0, 0.0, 0.0
    for i in own:
        x, y, z = x + points[i, 0], y + points[i, 1], z + points[i, 2]
    x, y, z = x / len(own), y / len(own), z / len(own)
    for i in own:
        square += (points[i, 0] - x) ** 2 + (points[i, 1] - y) ** 2 + (points[i, 2] - z) ** 2
    return np.sqrt(square / len(own))


@njit(cache=True, nogil=True, error_model="numpy")
def _triple(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    i: int,
    j: int,
    k: int,
    corners: NDArray[np.float64],
    filled: int,
) -> bool:
    """Writes the sides from the first point to the others, and two normals; whether the points lie apart."""
    ax, ay, az = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
    bx, by, bz = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1], points[k, 2] - points[i, 2]
    corners[0, filled], corners[1, filled], corners[2, filled] = ax, ay, az
    corners[3, filled], corners[4, filled], corners[5, filled] = bx, by, bz
    corners[6, filled], corners[7, filled], corners[8, filled] = normals[i]
    corners[9, filled], corners[10, filled], corners[11, filled] = normals[j]
    return ax * ax + ay * ay + az * az >= 1e-24 and bx * bx + by * by + bz * bz >= 1e-24


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
def _measure(corners: NDArray[np.float64], places: NDArray[np.float64], per_rms: float) -> None:
    """Where triples of points fall in each distribution (5, CHUNK), [0, 1], in place. Nothing branches."""
    for t in range(CHUNK):
        ax, ay, az = corners[0, t], corners[1, t], corners[2, t]
        bx, by, bz = corners[3, t], corners[4, t], corners[5, t]
        nx, ny, nz = corners[6, t], corners[7, t], corners[8, t]
        mx, my, mz = corners[9, t], corners[10, t], corners[11, t]
        cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        side = np.sqrt(ax * ax + ay * ay + az * az)
        cross = np.sqrt(cx * cx + cy * cy + cz * cz)
        facing = nx * mx + ny * my + nz * mz
        bulge = ((mx - nx) * ax + (my - ny) * ay + (mz - nz) * az) / side
        places[0, t] = side * per_rms / DISTANCE_RANGE
        places[1, t] = np.sqrt(cross / 2) * per_rms / AREA_RANGE
        places[2, t] = turn(cross, ax * bx + ay * by + az * bz) / np.pi
        places[3, t] = turn(np.sqrt(max(1 - facing * facing, 0.0)), facing) / np.pi
        places[4, t] = (bulge / 2 + 1) / 2


@njit(cache=True, nogil=True, error_model="numpy")
def _vote(places: NDArray[np.float64], filled: int, out: NDArray[np.float64]) -> None:
    """Shares each vote between the two bins whose centres enclose it, in place, so that rounding moves little."""
    for t in range(filled):
        for shape in range(SHAPES):
            place = min(max(places[shape, t], 0.0), 1.0) * SHAPE_BINS - 0.5
            left = int(np.floor(place))
            part = place - left
            first = shape * SHAPE_BINS
            out[first + max(left, 0)] += 1 - part
            out[first + min(left + 1, SHAPE_BINS - 1)] += part
