"""Fast point feature histograms: Rusu et al., "Fast Point Feature Histograms (FPFH) for 3D Registration", ICRA 2009."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from service.engine.angles import turn
from service.engine.neighbours import Neighbourhood

FPFH_BINS = 11  # of each of the three angles
CHUNK = 256  # pairs of points whose angles are measured together: as many as the nearest cache holds


def sum_fpfh(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    labels: NDArray[np.int64],
    near: Neighbourhood,
    closest: float,
) -> NDArray[np.float64]:
    """The sum over the points of each segment of their FPFH, of which each of the three angles' 11 bins sum to 1/3.

    FPFH(p) = SPFH(p) + 1/k sum of SPFH(p_k) / w_k, w_k the distance (Rusu et al. 2009, Eq. 2), normalised. As every
    SPFH has the same sum, what FPFH(p) is divided by is known from the distances alone, so that each SPFH is added up
    but once for a segment, times all that its points have of it.

    Args:
        points: (M, 3).
        normals: (M, 3), unit length.
        labels: (M,): the segment of each point, 0 to S - 1, each there.
        near: the neighbourhood of FPFH.
        closest: distances of less weigh as this one, in the points' unit.

    Returns:
        (S, 33).
    """
    votes = _votes(points, normals, near.indptr, near.indices)
    parts, uniform = _parts(labels, int(labels.max()) + 1, near.indptr, near.indices, near.squared, closest)
    return np.asarray(parts.T @ votes + uniform[:, None] / (3 * FPFH_BINS))


@njit(cache=True, nogil=True, error_model="numpy")
def _parts(
    labels: NDArray[np.int64],
    count: int,
    indptr: NDArray[np.int64],
    indices: NDArray[np.int32],
    squared: NDArray[np.float64],
    closest: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """How much of each point's votes is in the sum of each segment (M, S), and points without neighbours (S,)."""
    size = len(labels)
    out, alone = np.zeros((size, count)), np.zeros(count)
    weight = np.empty(len(squared))
    for k in range(len(squared)):
        weight[k] = 1 / max(np.sqrt(squared[k]), closest)
    for i in range(size):
        first, end = indptr[i], indptr[i + 1]
        others, segment = end - first - 1, labels[i]
        if others == 0:
            alone[segment] += 1
            continue
        total = 0.0
        for k in range(first, end):
            total += weight[k]
        total = 1 + (total - 1 / closest) / others  # all neighbours have neighbours; the point is one of its own
        for k in range(first, end):
            out[np.uint64(indices[k]), segment] += weight[k] / (others * total)
        out[i, segment] += (1 - 1 / (closest * others)) / total
    for i in range(size):
        each = 3 * max(indptr[i + 1] - indptr[i] - 1, 1)  # a pair votes once for each of the three angles
        for segment in range(count):
            out[i, segment] /= each
    return out, alone


@njit(cache=True, nogil=True, error_model="numpy")
def _votes(
    points: NDArray[np.float64], normals: NDArray[np.float64], indptr: NDArray[np.int64], indices: NDArray[np.int32]
) -> NDArray[np.int32]:
    """Simplified point feature histograms (M, 33), not normalised: the Darboux angles alpha, phi, theta to neighbours.

    A pair's angles are the same from either end, so each pair is measured once.
    """
    out = np.zeros((len(points), 3 * FPFH_BINS), np.int32)
    first, second = np.empty(CHUNK, np.int64), np.empty(CHUNK, np.int64)
    pairs, bins = np.empty((9, CHUNK)), np.empty((3, CHUNK), np.int32)
    filled = 0
    for i in range(len(points)):
        x, y, z = points[i]
        nx, ny, nz = normals[i]
        for place in range(indptr[i], indptr[i + 1]):
            j = np.uint64(indices[place])
            if indices[place] <= i:
                continue
            first[filled], second[filled] = i, j
            pairs[0, filled], pairs[1, filled], pairs[2, filled] = points[j, 0] - x, points[j, 1] - y, points[j, 2] - z
            pairs[3, filled], pairs[4, filled], pairs[5, filled] = nx, ny, nz
            pairs[6, filled], pairs[7, filled], pairs[8, filled] = normals[j, 0], normals[j, 1], normals[j, 2]
            filled += 1
            if filled == CHUNK:
                _measure(pairs, bins)
                _vote(first, second, bins, filled, out)
                filled = 0
    pairs[:, filled:] = 0.0
    _measure(pairs, bins)
    _vote(first, second, bins, filled, out)
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _vote(
    first: NDArray[np.int64],
    second: NDArray[np.int64],
    bins: NDArray[np.int32],
    filled: int,
    out: NDArray[np.int32],
) -> None:
    """Adds the votes of pairs to the histograms of both ends, in place."""
    for k in range(filled):
        i, j = np.uint64(first[k]), np.uint64(second[k])
        for angle in range(3):
            b = np.uint64(bins[angle, k])
            out[i, b] += 1
            out[j, b] += 1


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
def _measure(pairs: NDArray[np.float64], bins: NDArray[np.int32]) -> None:
    """The bins of the cosines of alpha and phi, and of theta (3, CHUNK), in place. Nothing branches.

    The frame stands where the normal is nearer to the joining line.

    Args:
        pairs: (9, CHUNK): the line from one point to the other, and the normals at both.
        bins: (3, CHUNK), of 33.
    """
    for k in range(CHUNK):
        dx, dy, dz = pairs[0, k], pairs[1, k], pairs[2, k]
        nx, ny, nz = pairs[3, k], pairs[4, k], pairs[5, k]
        mx, my, mz = pairs[6, k], pairs[7, k], pairs[8, k]
        per_length = 1 / max(np.sqrt(dx * dx + dy * dy + dz * dz), 1e-12)
        dx, dy, dz = dx * per_length, dy * per_length, dz * per_length
        at_n, at_m = nx * dx + ny * dy + nz * dz, mx * dx + my * dy + mz * dz
        turned = abs(at_n) < abs(at_m)
        side = -1.0 if turned else 1.0
        phi, other = side * (at_m if turned else at_n), side * (at_n if turned else at_m)
        # v is across the line and the normal u of the frame, w across u and v: u x (d x u) = d - (d . u) u
        vx, vy, vz = dy * nz - dz * ny, dz * nx - dx * nz, dx * ny - dy * nx
        ux, uy, uz = dy * mz - dz * my, dz * mx - dx * mz, dx * my - dy * mx
        alpha = -(ux * nx + uy * ny + uz * nz) if turned else vx * mx + vy * my + vz * mz
        across = np.sqrt(ux * ux + uy * uy + uz * uz if turned else vx * vx + vy * vy + vz * vz)
        facing = nx * mx + ny * my + nz * mz
        aligned = across < 1e-9
        per_across = 0.0 if aligned else 1 / across
        theta = turn((other - phi * facing) * per_across, 1.0 if aligned else facing)
        bins[0, k] = _bin((alpha * per_across + 1) / 2)
        bins[1, k] = FPFH_BINS + _bin((phi + 1) / 2)
        bins[2, k] = 2 * FPFH_BINS + _bin((theta + np.pi) * (0.5 / np.pi))


@njit(nogil=True, error_model="numpy", inline="always")
def _bin(share: float) -> int:
    """The bin of a value of [0, 1], of those of one angle."""
    return min(max(int(share * FPFH_BINS), 0), FPFH_BINS - 1)
