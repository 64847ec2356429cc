"""The building blocks of abstract objects, box, cylinder and sphere, each centred in its own frame.

A block knows its surface twice: exactly, as a signed distance with faces and normals, and as the triangle mesh that
is rendered.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

SURFACE_POINTS = 1024  # about one every centimetre on a block of household size


class Mesh(NamedTuple):
    """Triangles, seen from outside counter-clockwise.

    Attributes:
        vertices: (V, 3) float64, metres.
        triangles: (T, 3) int64, indices of vertices.
    """

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]


class Primitive(Protocol):
    """What box, cylinder and sphere have in common; points are (N, 3) metres in the primitive's frame."""

    def __hash__(self) -> int:
        """Equal blocks have equal surfaces."""

    @property
    def face_count(self) -> int:
        """Number of smooth faces."""

    def signed_distance(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) metres from the surface, negative inside."""

    def faces(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """(N,) the face that each point, on the surface, lies on."""

    def normals(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 3) outward unit normals at points on the surface."""

    def surface(self) -> NDArray[np.float64]:
        """(SURFACE_POINTS, 3) points spread evenly over the surface."""

    def mesh(self, chord: float) -> Mesh:
        """A closed mesh whose vertices lie on the surface and whose triangles are nowhere farther off than `chord`."""


@dataclass(frozen=True)
class Box:
    """A box with its edges along x, y and z. Faces: 0 and 1 at -x and +x, then those of y, then those of z."""

    length: float
    width: float
    height: float

    @property
    def face_count(self) -> int:  # noqa: D102
        return 6

    @property
    def _half(self) -> NDArray[np.float64]:
        return np.array([self.length, self.width, self.height]) / 2

    def signed_distance(self, points: NDArray[np.float64]) -> NDArray[np.float64]:  # noqa: D102
        beyond = np.abs(points) - self._half
        return np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(axis=1), 0)

    def faces(self, points: NDArray[np.float64]) -> NDArray[np.int64]:  # noqa: D102
        axis = np.argmax(np.abs(points) - self._half, axis=1)
        return 2 * axis + (points[np.arange(len(points)), axis] > 0)

    def normals(self, points: NDArray[np.float64]) -> NDArray[np.float64]:  # noqa: D102
        outward = np.repeat(np.eye(3), 2, axis=0) * np.tile([-1.0, 1.0], 3)[:, None]  # (6, 3)
        return outward[self.faces(points)]

    def surface(self) -> NDArray[np.float64]:  # noqa: D102
        half = self._half
        areas = np.repeat([half[1] * half[2], half[0] * half[2], half[0] * half[1]], 2)
        face, a, b = _choose_face(areas)
        axis = face // 2
        points = np.empty((SURFACE_POINTS, 3))
        rows = np.arange(SURFACE_POINTS)
        points[rows, axis] = np.where(face % 2, 1.0, -1.0)
        points[rows, (axis + 1) % 3] = 2 * a - 1
        points[rows, (axis + 2) % 3] = 2 * b - 1
        return points * half

    def mesh(self, chord: float) -> Mesh:  # noqa: D102
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * self._half
        quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
        return Mesh(corners, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))


@dataclass(frozen=True)
class Cylinder:
    """A cylinder about z. Faces: 0 is the side, 1 the lid at +z, 2 the bottom at -z."""

    radius: float
    height: float

    @property
    def face_count(self) -> int:  # noqa: D102
        return 3

    def _beyond(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 2) how far each point lies outside the side and outside lid and bottom."""
        across = np.hypot(points[:, 0], points[:, 1]) - self.radius
        return np.stack([across, np.abs(points[:, 2]) - self.height / 2], axis=1)

    def signed_distance(self, points: NDArray[np.float64]) -> NDArray[np.float64]:  # noqa: D102
        beyond = self._beyond(points)
        return np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(axis=1), 0)

    def faces(self, points: NDArray[np.float64]) -> NDArray[np.int64]:  # noqa: D102
        on_end = np.argmax(self._beyond(points), axis=1)
        return on_end * np.where(points[:, 2] > 0, 1, 2)

    def normals(self, points: NDArray[np.float64]) -> NDArray[np.float64]:  # noqa: D102
        outward = np.zeros_like(points)
        on_side = self.faces(points) == 0
        radial = points[on_side, :2]
        outward[on_side, :2] = radial / np.maximum(np.linalg.norm(radial, axis=1, keepdims=True), 1e-12)
        outward[~on_side, 2] = np.sign(points[~on_side, 2])
        return outward

    def surface(self) -> NDArray[np.float64]:  # noqa: D102
        face, a, b = _choose_face(np.array([2 * self.height, self.radius, self.radius]))
        across = np.where(face == 0, self.radius, self.radius * np.sqrt(b))
        along = np.choose(face, [b - 0.5, 0.5, -0.5]) * self.height
        return np.stack([across * np.cos(2 * np.pi * a), across * np.sin(2 * np.pi * a), along], axis=1)

    def mesh(self, chord: float) -> Mesh:  # noqa: D102
        n = _sides(self.radius, chord)
        angle = 2 * np.pi * np.arange(n) / n
        ring = np.stack([self.radius * np.cos(angle), self.radius * np.sin(angle), np.zeros(n)], axis=1)
        up = np.array([0, 0, self.height / 2])
        here, after = np.arange(n), (np.arange(n) + 1) % n
        bottom, lid = np.full(n, 2 * n), np.full(n, 2 * n + 1)
        triangles = [
            (here, after, n + after),
            (here, n + after, n + here),
            (bottom, after, here),
            (lid, n + here, n + after),
        ]
        return Mesh(np.concatenate([ring - up, ring + up, [-up, up]]), _stacked(triangles))


@dataclass(frozen=True)
class Sphere:
    """A sphere. Its one face is 0."""

    radius: float

    @property
    def face_count(self) -> int:  # noqa: D102
        return 1

    def signed_distance(self, points: NDArray[np.float64]) -> NDArray[np.float64]:  # noqa: D102
        return np.linalg.norm(points, axis=1) - self.radius

    def faces(self, points: NDArray[np.float64]) -> NDArray[np.int64]:  # noqa: D102
        return np.zeros(len(points), dtype=np.int64)

    def normals(self, points: NDArray[np.float64]) -> NDArray[np.float64]:  # noqa: D102
        return points / np.maximum(np.linalg.norm(points, axis=1, keepdims=True), 1e-12)

    def surface(self) -> NDArray[np.float64]:  # noqa: D102
        _, a, b = _choose_face(np.ones(1))
        z = 2 * b - 1
        across = np.sqrt(1 - z**2)
        return self.radius * np.stack([across * np.cos(2 * np.pi * a), across * np.sin(2 * np.pi * a), z], axis=1)

    def mesh(self, chord: float) -> Mesh:  # noqa: D102
        # A quad bends both ways: the middle of its diagonal is twice as deep as the middle of an edge.
        m = -(-_sides(self.radius, chord / 2) // 2)
        n = 2 * m
        azimuth = 2 * np.pi * np.arange(n) / n
        polar = np.pi * np.arange(1, m) / m
        rings = np.stack(
            [
                np.outer(np.sin(polar), np.cos(azimuth)),
                np.outer(np.sin(polar), np.sin(azimuth)),
                np.outer(np.cos(polar), np.ones(n)),
            ],
            axis=-1,
        ).reshape(-1, 3)
        vertices = self.radius * np.concatenate([rings, [[0, 0, 1], [0, 0, -1]]])
        north, south, last = len(rings), len(rings) + 1, n * (m - 2)
        here, after = np.arange(n), (np.arange(n) + 1) % n
        triangles = [(np.full(n, north), here, after), (np.full(n, south), last + after, last + here)]
        rows = n * np.arange(m - 2)[:, None]
        here, after = (rows + here).ravel(), (rows + after).ravel()
        triangles += [(here, n + here, n + after), (here, n + after, after)]
        return Mesh(vertices, _stacked(triangles))


def _sides(radius: float, sagitta: float) -> int:
    """Least number of sides of a regular polygon in a circle whose edges' middles are that far from it at most.

    The middle of one of n edges is radius (1 - cos(pi / n)) <= radius pi^2 / (2 n^2) from the circle.
    """
    return max(12, int(np.ceil(np.pi * np.sqrt(radius / (2 * sagitta)))))


def _stacked(triangles: Sequence[tuple[NDArray[np.int64], ...]]) -> NDArray[np.int64]:
    return np.concatenate([np.stack(corner, axis=1) for corner in triangles])


@cache
def _even_pairs(count: int) -> NDArray[np.float64]:
    """(count, 2) evenly spread over the unit square: the Kronecker sequence of the plastic number."""
    plastic = 1.32471795724474602596
    pairs: NDArray[np.float64] = (0.5 + np.outer(np.arange(count), [1 / plastic, 1 / plastic**2])) % 1.0
    pairs.flags.writeable = False
    return pairs


def _choose_face(areas: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Shares evenly spread points out among faces by area: the face (N,) and two coordinates in [0, 1) on it."""
    a, b = _even_pairs(SURFACE_POINTS).T
    ends = np.cumsum(areas) / np.sum(areas)
    face = np.minimum(np.searchsorted(ends, a, side="right"), len(areas) - 1)
    starts = np.concatenate([[0.0], ends[:-1]])
    return face, (a - starts[face]) / (ends - starts)[face], b
