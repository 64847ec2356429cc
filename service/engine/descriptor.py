"""Descriptions of segments and constellations: FPFH, and distributions that see how parts are arranged.

FPFH: Rusu et al., "Fast Point Feature Histograms (FPFH) for 3D Registration", ICRA 2009. Shape distributions: after
Osada et al., "Shape Distributions", ACM TOG 2002, with the angles between normals and the convexity of pairs beside.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from service.engine.neighbours import neighbourhood
from service.engine.params import DescriptorParams
from service.engine.segments import SegmentGraph

FPFH_BINS = 11  # of each of the three angles
NEAR_BORDER = 1e-3  # bins; well beyond the error of the polynomial for angles
SHAPE_BINS = 24  # of each of the five distributions
SHAPES = 5
DISTANCE_RANGE = 4.0  # pair distances, rms radii
AREA_RANGE = 2.0  # square roots of triangle areas, rms radii


def describe(graph: SegmentGraph, members: NDArray[np.bool_], params: DescriptorParams) -> NDArray[np.float32]:
    """Describes constellations of an object's segments.

    The FPFH of a constellation is the mean over its points. Beside it stand, where `shape_weight` is not 0, five
    histograms over random pairs and triples of its points: distance and square root of the triangle's area (both over
    the constellation's rms radius), angle at a point, angle between two normals, signed convexity of two normals
    against the joining line.

    Args:
        graph: the object's segments.
        members: (C, S): which segments are united in each constellation, at least one.
        params: weights, radius and draws.

    Returns:
        (C, D) float32, each row a distribution that sums to 1; D is 33, or 153 with the shape distributions.
    """
    of_points = fpfh(graph, max(params.fpfh_radius, 3 * graph.voxel))
    sums = np.zeros((graph.count, of_points.shape[1]))
    np.add.at(sums, graph.labels, of_points)
    mean = members @ sums
    mean /= mean.sum(axis=1, keepdims=True)
    if params.shape_weight == 0:
        return mean.astype(np.float32)
    triples = np.random.default_rng(0).random((params.draws, 3))  # the same for all: part of the descriptor
    shape = np.stack([_shape(graph.points[m], graph.normals[m], triples) for m in members[:, graph.labels]])
    return np.hstack([(1 - params.shape_weight) * mean, params.shape_weight * shape]).astype(np.float32)


def fpfh(graph: SegmentGraph, radius: float) -> NDArray[np.float64]:
    """Fast point feature histograms of all points (M, 33), each of the three angles' 11 bins summing to 1/3.

    Args:
        graph: points and normals.
        radius: of the neighbourhood, extents.
    """
    near = neighbourhood(graph.points, radius)
    simple = _spfh(graph.points, graph.normals, near.indptr, near.indices)
    return _weighted(simple, graph.points, near.indptr, near.indices, graph.voxel / 4)


@njit(cache=True, nogil=True)
def _spfh(
    points: NDArray[np.float64], normals: NDArray[np.float64], indptr: NDArray[np.int64], indices: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Simplified point feature histograms (M, 33): the Darboux angles alpha, phi, theta to each neighbour.

    A pair's angles are the same from either end, so each pair is measured once.
    """
    out = np.zeros((len(points), 3 * FPFH_BINS))
    for i in range(len(points)):
        for j in indices[indptr[i] : indptr[i + 1]]:
            if j <= i:
                continue
            alpha, phi, y, x = _darboux(points, normals, i, j)
            first = _bin((alpha + 1) / 2, FPFH_BINS)
            second = FPFH_BINS + _bin((phi + 1) / 2, FPFH_BINS)
            third = 2 * FPFH_BINS + _angle_bin(y, x)
            for end in (i, j):
                out[end, first] += 1
                out[end, second] += 1
                out[end, third] += 1
    for i in range(len(points)):
        total = 0.0
        for b in range(FPFH_BINS):  # a pair votes once for each of the three angles
            total += out[i, b]
        for b in range(3 * FPFH_BINS):
            out[i, b] /= max(3 * total, 1.0)
    return out


@njit(cache=True, nogil=True)
def _weighted(
    simple: NDArray[np.float64],
    points: NDArray[np.float64],
    indptr: NDArray[np.int64],
    indices: NDArray[np.int64],
    closest: float,
) -> NDArray[np.float64]:
    """FPFH(p) = SPFH(p) + 1/k sum of SPFH(p_k) / w_k, w_k the distance (Rusu et al. 2009, Eq. 2), normalised."""
    out = simple.copy()
    for i in range(len(points)):
        k = max(indptr[i + 1] - indptr[i] - 1, 1)
        for j in indices[indptr[i] : indptr[i + 1]]:
            if i != j:
                dx, dy, dz = points[i, 0] - points[j, 0], points[i, 1] - points[j, 1], points[i, 2] - points[j, 2]
                weight = 1.0 / (k * max(np.sqrt(dx * dx + dy * dy + dz * dz), closest))
                for b in range(3 * FPFH_BINS):
                    out[i, b] += weight * simple[j, b]
        total = out[i].sum()
        for b in range(3 * FPFH_BINS):
            out[i, b] = out[i, b] / total if total > 0 else 1.0 / (3 * FPFH_BINS)
    return out


@njit(cache=True, nogil=True, inline="always")
def _darboux(
    points: NDArray[np.float64], normals: NDArray[np.float64], i: int, j: int
) -> tuple[float, float, float, float]:
    """A pair's cos alpha, cos phi, and theta as a point (x, y) in its direction: y, x.

    The frame stands where the normal is nearer to the joining line.
    """
    dx, dy, dz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
    nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
    mx, my, mz = normals[j, 0], normals[j, 1], normals[j, 2]
    length = max(np.sqrt(dx * dx + dy * dy + dz * dz), 1e-12)
    dx, dy, dz = dx / length, dy / length, dz / length
    at_i = nx * dx + ny * dy + nz * dz
    at_j = mx * dx + my * dy + mz * dz
    if abs(at_i) < abs(at_j):
        nx, ny, nz, mx, my, mz = mx, my, mz, nx, ny, nz
        dx, dy, dz, at_i = -dx, -dy, -dz, -at_j
    vx, vy, vz = dy * nz - dz * ny, dz * nx - dx * nz, dx * ny - dy * nx
    length = np.sqrt(vx * vx + vy * vy + vz * vz)
    if length < 1e-9:
        return 0.0, at_i, 0.0, 1.0
    vx, vy, vz = vx / length, vy / length, vz / length
    wx, wy, wz = ny * vz - nz * vy, nz * vx - nx * vz, nx * vy - ny * vx
    return vx * mx + vy * my + vz * mz, at_i, wx * mx + wy * my + wz * mz, nx * mx + ny * my + nz * mz


@njit(cache=True, nogil=True, inline="always")
def _angle_bin(y: float, x: float) -> int:
    """The bin of arctan2(y, x) of the whole turn: from a polynomial, unless that is too near to a border to tell."""
    place = (_rough_angle(y, x) + np.pi) / (2 * np.pi) * FPFH_BINS
    if abs(place - np.rint(place)) < NEAR_BORDER:
        return _bin((np.arctan2(y, x) + np.pi) / (2 * np.pi), FPFH_BINS)
    return int(place)


@njit(cache=True, nogil=True, inline="always")
def _rough_angle(y: float, x: float) -> float:
    """arctan2(y, x) to 1e-4 (Abramowitz and Stegun, Handbook of Mathematical Functions, 4.4.47)."""
    across, along = abs(y), abs(x)
    t = min(across, along) / max(across, along, 1e-300)
    u = t * t
    angle = t * (0.9998660 + u * (-0.3302995 + u * (0.1801410 + u * (-0.0851330 + u * 0.0208351))))
    if across > along:
        angle = np.pi / 2 - angle
    if x < 0:
        angle = np.pi - angle
    return -angle if y < 0 else angle


@njit(cache=True, nogil=True, inline="always")
def _bin(value: float, bins: int) -> int:
    """The bin of a value of [0, 1]."""
    return min(max(int(value * bins), 0), bins - 1)


@njit(cache=True, nogil=True)
def _shape(
    points: NDArray[np.float64], normals: NDArray[np.float64], triples: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The five shape distributions of a set of points (120,), summing to 1.

    `triples` (T, 3) are uniform in [0, 1) and pick points by their place in the cloud's own order.
    """
    size = len(points)
    mean = np.zeros(3)
    for p in points:
        mean += p / size
    rms = 0.0
    for p in points:
        rms += ((p - mean) ** 2).sum() / size
    rms = max(np.sqrt(rms), 1e-9)
    out = np.zeros((SHAPES, SHAPE_BINS))
    for t in range(len(triples)):
        i, j, k = int(triples[t, 0] * size), int(triples[t, 1] * size), int(triples[t, 2] * size)
        if i in (j, k) or j == k:
            continue
        ax, ay, az = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
        bx, by, bz = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1], points[k, 2] - points[i, 2]
        a, b = np.sqrt(ax * ax + ay * ay + az * az), np.sqrt(bx * bx + by * by + bz * bz)
        if a < 1e-12 or b < 1e-12:
            continue
        cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        cross = np.sqrt(cx * cx + cy * cy + cz * cz)
        dot = ax * bx + ay * by + az * bz
        n, m = normals[i], normals[j]
        facing = n[0] * m[0] + n[1] * m[1] + n[2] * m[2]
        bulge = ((m[0] - n[0]) * ax + (m[1] - n[1]) * ay + (m[2] - n[2]) * az) / a
        _vote(out[0], a / rms / DISTANCE_RANGE)
        _vote(out[1], np.sqrt(cross / 2) / rms / AREA_RANGE)
        _vote(out[2], np.arctan2(cross, dot) / np.pi)
        _vote(out[3], np.arccos(min(max(facing, -1.0), 1.0)) / np.pi)
        _vote(out[4], (bulge / 2 + 1) / 2)
    total = out.sum()
    return out.ravel() / total if total > 0 else np.full(SHAPES * SHAPE_BINS, 1.0 / (SHAPES * SHAPE_BINS))


@njit(cache=True, nogil=True)
def _vote(histogram: NDArray[np.float64], value: float) -> None:
    """Shares one vote between the two bins whose centres enclose a value of [0, 1], so that rounding moves little."""
    place = min(max(value, 0.0), 1.0) * len(histogram) - 0.5
    left = int(np.floor(place))
    part = place - left
    histogram[max(left, 0)] += 1 - part
    histogram[min(left + 1, len(histogram) - 1)] += part
