"""Ensemble of shape functions: the strongest ready-made descriptor of whole clouds, to measure against.

Wohlkinger and Vincze, "Ensemble of Shape Functions for 3D Object Classification", ROBIO 2011: distances (D2), areas
(D3) and angles (A3) of random points, told apart by where the lines between the points run. The thresholds of "in" and
"out" are those of the authors' implementation in the Point Cloud Library.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

BINS = 64
HISTOGRAMS = 10  # A3, D3 and D2 of three kinds of lines each, and the ratio of mixed lines
GRID = 64  # voxels a side
TRIPLES = 60_000  # of random points, thrice the authors': fewer blur what the histograms tell
OPEN_ENDS = 7  # voxels of a line that its own end points may occupy: a line with no more runs outside
SLIVER = 0.03  # square root of a triangle's area, voxels, below which its angles mean nothing
IN, OUT, MIXED = 0, 1, 2  # a line runs along the surface, off it, or both


def ensemble_of_shape_functions(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Describes a whole cloud.

    Args:
        points: (N, 3), at least 3 different ones, in any unit; their order is part of the input, as random places in
            it are drawn, the same for all clouds.

    Returns:
        (640,) summing to 1: A3, D3 and D2, each in, out and mixed, and the ratio of D2; 64 bins each.
    """
    centred = points - points.mean(axis=0)
    scaled = centred / np.linalg.norm(centred, axis=1).max() * (GRID / 2)
    cells = np.clip(np.floor(scaled + GRID / 2).astype(np.int64), 0, GRID - 1)
    triples = (np.random.default_rng(0).random((TRIPLES, 3)) * len(points)).astype(np.int64)
    histograms = _vote(scaled, cells, _occupied(cells), triples)
    return np.asarray(histograms.ravel() / histograms.sum())


def _occupied(cells: NDArray[np.int64]) -> NDArray[np.bool_]:
    """The voxels in which a point lies, and all that touch them (64, 64, 64): a surface without holes."""
    grid = np.zeros((GRID + 2,) * 3, dtype=bool)
    for step in np.ndindex(3, 3, 3):
        grid[tuple((cells + step).T)] = True
    return grid[1:-1, 1:-1, 1:-1]


@njit(cache=True, nogil=True)
def _vote(
    points: NDArray[np.float64], cells: NDArray[np.int64], grid: NDArray[np.bool_], triples: NDArray[np.int64]
) -> NDArray[np.float64]:
    """The histograms (10, 64) of triples (T, 3) of points."""
    lengths, areas = np.zeros((len(triples), 3)), np.zeros(len(triples))
    for t in range(len(triples)):
        for e in range(3):
            p, q = triples[t, e], triples[t, (e + 1) % 3]
            lengths[t, e] = np.sqrt(((points[p] - points[q]) ** 2).sum())
        areas[t] = _root_area(lengths[t, 0], lengths[t, 1], lengths[t, 2])
    longest, widest = max(lengths.max(), 1e-12), max(areas.max(), 1e-12)

    out = np.zeros((HISTOGRAMS, BINS))
    for t in range(len(triples)):
        if areas[t] < SLIVER:
            continue
        steps, hits, angles = np.zeros(3, np.int64), np.zeros(3, np.int64), np.zeros(3)
        for e in range(3):
            steps[e], hits[e] = _trace(grid, cells[triples[t, e]], cells[triples[t, (e + 1) % 3]])
            kind = _kind(steps[e], hits[e], 1, OPEN_ENDS)
            out[6 + kind, _bin(lengths[t, e] / longest)] += 1
            if kind == MIXED:
                out[9, _bin(hits[e] / steps[e])] += 1
            a, b, c = lengths[t, e], lengths[t, (e + 1) % 3], lengths[t, (e + 2) % 3]
            cosine = abs(b * b + c * c - a * a) / (2 * b * c)  # of the angle that faces the line
            angles[e] = np.arccos(min(cosine, 1.0)) / (np.pi / 2)
        kind = _kind(steps.sum(), hits.sum(), 3, 3 * OPEN_ENDS)
        for e in range(3):
            out[kind, _bin(angles[e])] += steps[e] / (GRID / 2)
        out[3 + kind, _bin(areas[t] / widest)] += 1
    return out


@njit(cache=True, nogil=True)
def _trace(grid: NDArray[np.bool_], start: NDArray[np.int64], end: NDArray[np.int64]) -> tuple[int, int]:
    """How many voxels a straight line visits, one for each step along its longest axis, and how many are occupied."""
    steps = max(abs(end[0] - start[0]), abs(end[1] - start[1]), abs(end[2] - start[2]), 1)
    hits = 0
    for s in range(steps):
        x = (2 * start[0] * steps + 2 * s * (end[0] - start[0]) + steps) // (2 * steps)
        y = (2 * start[1] * steps + 2 * s * (end[1] - start[1]) + steps) // (2 * steps)
        z = (2 * start[2] * steps + 2 * s * (end[2] - start[2]) + steps) // (2 * steps)
        hits += grid[x, y, z]
    return steps, hits


@njit(cache=True, nogil=True)
def _kind(steps: int, hits: int, missing: int, ends: int) -> int:
    """Along the surface where at most `missing` voxels are free, off it where at most `ends` are occupied."""
    if hits >= steps - missing:
        return IN
    return OUT if hits <= ends else MIXED


@njit(cache=True, nogil=True)
def _root_area(a: float, b: float, c: float) -> float:
    """The square root of a triangle's area, by Heron's formula."""
    s = (a + b + c) / 2
    return np.sqrt(np.sqrt(max(s * (s - a) * (s - b) * (s - c), 0.0)))


@njit(cache=True, nogil=True)
def _bin(value: float) -> int:
    """The bin of a value of [0, 1]."""
    return min(int(value * BINS), BINS - 1)
