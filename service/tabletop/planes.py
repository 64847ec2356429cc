"""The largest planes of a scene, by RANSAC.

Written with SciPy rather than taken from Open3D, whose plane segmentation draws from one generator of the whole
process: two scenes answered at once would not be answered alike twice.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from service.tabletop.records import Plane, TabletopParams

SAMPLE = 10_000  # voxels on which hypotheses are tried
NEIGHBOURS = 40  # of those, around one, that make a hypothesis
BEST = 10  # hypotheses that are refined (locally optimised RANSAC, Chum, Matas and Kittler 2003)
THICKNESS = 0.01  # metres from a hypothesis within which a voxel agrees with it
THINNEST, THICKEST = 0.005, 0.03  # metres: bounds on the band, whatever the sensor's noise


def find_planes(points: NDArray[np.float64], size: float, params: TabletopParams) -> Iterator[Plane]:
    """Planes of a scene, the one of most voxels first; each is looked for in what the ones before left.

    Args:
        points: (V, 3) the voxels' points, metres, in an order of their own.
        size: the voxels' edge, metres.
        params: hypotheses, planes and min_plane are used.
    """
    rng = np.random.default_rng(0)
    rest = points
    least = max(params.min_plane * len(points), NEIGHBOURS)
    for _ in range(params.planes):
        if len(rest) < least:
            return
        plane = _find_plane(rest, size, params, rng)
        agreeing = np.abs(plane.heights(rest)) <= plane.band
        if np.count_nonzero(agreeing) < least:
            return
        yield plane
        rest = rest[~agreeing]


def _find_plane(points: NDArray[np.float64], size: float, params: TabletopParams, rng: np.random.Generator) -> Plane:
    sample = points if len(points) <= SAMPLE else points[np.sort(rng.choice(len(points), SAMPLE, replace=False))]
    seeds = sample[rng.integers(len(sample), size=params.hypotheses)]
    around = sample[cKDTree(sample).query(seeds, min(NEIGHBOURS, len(sample)))[1]]  # (H, k, 3)
    centred = around - around.mean(axis=1, keepdims=True)
    normals = np.linalg.eigh(np.einsum("hki,hkj->hij", centred, centred))[1][:, :, 0]
    offsets = -np.einsum("hi,hi->h", normals, around.mean(axis=1))
    thickness = max(THICKNESS, size)
    agreeing = [np.count_nonzero(np.abs(sample @ n + d) <= thickness) for n, d in zip(normals, offsets, strict=True)]
    best = np.argsort(agreeing, kind="stable")[::-1][:BEST]
    refined = [_refine(sample, normals[i], offsets[i], thickness) for i in best]
    normal, offset = max(refined, key=lambda found: np.count_nonzero(np.abs(sample @ found[0] + found[1]) <= thickness))
    normal, offset = _refine(points, normal, offset, thickness)
    if offset < 0:
        normal, offset = -normal, -offset
    away = np.abs(points @ normal + offset)
    noise = 1.4826 * np.median(np.append(away[away <= 2 * thickness], 0.0))  # the zero: there may be no point
    return Plane(normal, float(offset), float(np.clip(3 * noise, THINNEST, THICKEST)))


def _refine(
    points: NDArray[np.float64], normal: NDArray[np.float64], offset: float, thickness: float
) -> tuple[NDArray[np.float64], float]:
    """The plane of least squares through the points near a plane, again and again."""
    for band in (2 * thickness, 1.5 * thickness, thickness, thickness):
        near = points[np.abs(points @ normal + offset) <= band]
        if len(near) < 3:
            break
        centre = near.mean(axis=0)
        normal = np.linalg.eigh((near - centre).T @ (near - centre))[1][:, 0]
        offset = -float(normal @ centre)
    return normal, offset
