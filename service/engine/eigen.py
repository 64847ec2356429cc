"""The principal axes of many small covariances, one after the other.

Eberly, "A Robust Eigensolver for 3 x 3 Symmetric Matrices", Geometric Tools 2014: no iteration, the axis that stands
most apart first.
"""

from __future__ import annotations

import numpy as np
from numba import njit

Vector = tuple[float, float, float]
Symmetric = tuple[float, float, float, float, float, float]
"""xx, xy, xz, yy, yz, zz."""

ROUND = 1e-14  # spread of the variances, relative to their mean, under which all directions are alike


@njit(cache=True, nogil=True, error_model="numpy")
def principal_axes(matrix: Symmetric) -> tuple[Vector, Vector, Vector]:
    """The eigenvalues of a symmetric matrix, ascending, and the unit eigenvectors of the first and of the last."""
    xx, xy, xz, yy, yz, zz = matrix
    mean = (xx + yy + zz) / 3
    dx, dy, dz = xx - mean, yy - mean, zz - mean
    spread = np.sqrt((dx * dx + dy * dy + dz * dz + 2 * (xy * xy + xz * xz + yz * yz)) / 6)
    if spread <= ROUND * abs(mean):  # of points that all but coincide rounding may leave less than nothing
        return (mean, mean, mean), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)
    half = (dx * (dy * dz - yz * yz) - xy * (xy * dz - yz * xz) + xz * (xy * yz - dy * xz)) / (2 * spread**3)
    angle = np.arccos(min(max(half, -1.0), 1.0)) / 3
    top_apart = half >= 0
    apart = mean + 2 * spread * np.cos(angle if top_apart else angle + 2 * np.pi / 3)
    first = _null_of(xx - apart, xy, xz, yy - apart, yz, zz - apart)
    low, high, across = _within_plane(matrix, first)
    if top_apart:
        return (low, high, apart), across, first
    return (apart, low, high), first, _cross(first, across)


@njit(cache=True, nogil=True, error_model="numpy")
def _null_of(xx: float, xy: float, xz: float, yy: float, yz: float, zz: float) -> Vector:
    """The unit vector that a symmetric matrix of rank 2 maps to 0: across the two rows that span most."""
    a, b, c = (xx, xy, xz), (xy, yy, yz), (xz, yz, zz)
    ab, ac, bc = _cross(a, b), _cross(a, c), _cross(b, c)
    ab2, ac2, bc2 = _square(ab), _square(ac), _square(bc)
    best, square = (ab, ab2) if ab2 >= ac2 and ab2 >= bc2 else ((ac, ac2) if ac2 >= bc2 else (bc, bc2))
    length = np.sqrt(square)
    return (best[0] / length, best[1] / length, best[2] / length)


@njit(cache=True, nogil=True, error_model="numpy")
def _within_plane(matrix: Symmetric, axis: Vector) -> tuple[float, float, Vector]:
    """The two eigenvalues across a known eigenvector, ascending, and the unit eigenvector of the smaller one."""
    if abs(axis[0]) > abs(axis[1]):
        length = np.sqrt(axis[0] ** 2 + axis[2] ** 2)
        u = (-axis[2] / length, 0.0, axis[0] / length)
    else:
        length = np.sqrt(axis[1] ** 2 + axis[2] ** 2)
        u = (0.0, axis[2] / length, -axis[1] / length)
    v = _cross(axis, u)
    mu, mv = _times(matrix, u), _times(matrix, v)
    uu = u[0] * mu[0] + u[1] * mu[1] + u[2] * mu[2]
    uv = u[0] * mv[0] + u[1] * mv[1] + u[2] * mv[2]
    vv = v[0] * mv[0] + v[1] * mv[1] + v[2] * mv[2]
    middle, part = (uu + vv) / 2, (uu - vv) / 2
    root = np.sqrt(part * part + uv * uv)
    # of the two rows of (matrix - smaller eigenvalue) the longer one is across the eigenvector
    c, s = (-uv, part + root) if part >= 0 else (root - part, -uv)
    length = np.sqrt(c * c + s * s)
    c, s = (c / length, s / length) if length > 0 else (1.0, 0.0)
    return middle - root, middle + root, (c * u[0] + s * v[0], c * u[1] + s * v[1], c * u[2] + s * v[2])


@njit(cache=True, nogil=True, error_model="numpy")
def _times(matrix: Symmetric, v: Vector) -> Vector:
    xx, xy, xz, yy, yz, zz = matrix
    return (
        xx * v[0] + xy * v[1] + xz * v[2],
        xy * v[0] + yy * v[1] + yz * v[2],
        xz * v[0] + yz * v[1] + zz * v[2],
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _cross(a: Vector, b: Vector) -> Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@njit(cache=True, nogil=True, error_model="numpy")
def _square(a: Vector) -> float:
    return a[0] * a[0] + a[1] * a[1] + a[2] * a[2]
