"""Abstract objects: compositions of randomly drawn prototypes (Alg. 1)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from worker.simulation.params import PrototypeParams
from worker.simulation.primitives import Box, Cylinder, Mesh, Primitive, Sphere

Kind = Literal["box", "cylinder", "sphere"]
KINDS: tuple[Kind, ...] = ("box", "cylinder", "sphere")


@dataclass(frozen=True)
class Prototype:
    """A primitive-shaped building block in its place.

    Attributes:
        kind: which primitive.
        dimensions: metres; box: length, width, height; cylinder: radius, height; sphere: radius.
        pose: (4, 4) float64 from the prototype's frame to the composition's, metres.
    """

    kind: Kind
    dimensions: tuple[float, ...]
    pose: NDArray[np.float64]

    @property
    def primitive(self) -> Primitive:
        """The prototype's shape, in its own frame."""
        if self.kind == "box":
            return Box(*self.dimensions)
        return Cylinder(*self.dimensions) if self.kind == "cylinder" else Sphere(*self.dimensions)

    def to_local(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (N, 3) of the composition's frame in the prototype's."""
        return (points - self.pose[:3, 3]) @ self.pose[:3, :3]

    def signed_distance(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) metres from the surface to points of the composition's frame, negative inside."""
        return self.primitive.signed_distance(self.to_local(points))

    def surface(self) -> NDArray[np.float64]:
        """(S, 3) points spread evenly over the surface, in the composition's frame."""
        return _surface_of(self.primitive) @ self.pose[:3, :3].T + self.pose[:3, 3]

    def mesh(self, chord: float) -> Mesh:
        """The surface as triangles in the composition's frame, nowhere more than `chord` metres off."""
        vertices, triangles = self.primitive.mesh(chord)
        return Mesh(vertices @ self.pose[:3, :3].T + self.pose[:3, 3], triangles)


@lru_cache(maxsize=64)  # an object's, each of which is placed, and looked at, many times
def _surface_of(primitive: Primitive) -> NDArray[np.float64]:
    points = primitive.surface()
    points.flags.writeable = False
    return points


@dataclass(frozen=True)
class Composition:
    """An abstract object: prototypes, each of which crosses the surface of an earlier one."""

    prototypes: tuple[Prototype, ...]

    @property
    def order(self) -> int:
        """The prototype order: their number."""
        return len(self.prototypes)

    def bounding_sphere(self) -> tuple[NDArray[np.float64], float]:
        """Middle (3,) of the bounding box, and the radius of a sphere about it that holds the object, metres."""
        points = np.concatenate([prototype.mesh(1e-3).vertices for prototype in self.prototypes])
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        return middle, float(np.linalg.norm(points - middle, axis=1).max())

    def faces(self, points: NDArray[np.float64], labels: NDArray[np.int64]) -> NDArray[np.int64]:
        """The smooth face each point lies on, numbered through all prototypes in turn.

        Args:
            points: (N, 3) on the surface, in the composition's frame, metres.
            labels: (N,) index of the prototype that each point lies on.
        """
        faces = np.empty(len(points), dtype=np.int64)
        first = 0
        for index, prototype in enumerate(self.prototypes):
            mine = labels == index
            faces[mine] = first + prototype.primitive.faces(prototype.to_local(points[mine]))
            first += prototype.primitive.face_count
        return faces

    def normals(self, points: NDArray[np.float64], labels: NDArray[np.int64]) -> NDArray[np.float64]:
        """(N, 3) outward unit normals of the true surface; arguments as of `faces`."""
        normals = np.empty_like(points)
        for index, prototype in enumerate(self.prototypes):
            mine = labels == index
            local = prototype.primitive.normals(prototype.to_local(points[mine]))
            normals[mine] = local @ prototype.pose[:3, :3].T
        return normals


def compose(order: int, params: PrototypeParams, rng: np.random.Generator) -> Composition:
    """Draws an abstract object of so many prototypes: Alg. 1."""
    sample: tuple[Prototype, ...] = ()
    while len(sample) < order:
        kind = KINDS[rng.integers(len(KINDS))]
        dimensions = draw_dimensions(kind, params, rng)
        prototype = Prototype(kind, dimensions, np.eye(4))
        if sample:
            prototype = draw_intersecting_pose(prototype, sample, params, rng)
        sample = (*sample, prototype)
    return Composition(sample)


def draw_dimensions(kind: Kind, params: PrototypeParams, rng: np.random.Generator) -> tuple[float, ...]:
    """Edges, heights and diameters, each uniform over its range; metres, as in `Prototype.dimensions`."""
    scale = {"box": (1.0, 1.0, 1.0), "cylinder": (0.5, 1.0), "sphere": (0.5,)}[kind]
    return tuple(float(s * rng.uniform(params.shortest, params.longest)) for s in scale)


def draw_intersecting_pose(
    prototype: Prototype, sample: tuple[Prototype, ...], params: PrototypeParams, rng: np.random.Generator
) -> Prototype:
    """The prototype in a random pose in which it intersects the sample (Alg. 1).

    Poses are uniform over a box that holds all those in which the two can touch. Those that do not intersect at least
    `overlap` deep are drawn again, and, which Alg. 1 does not ask, those that swallow a prototype: less than the share
    `exposed` of its surface would stay outside. With `exposed` 0 it is the paper's.
    """
    points = np.concatenate([other.surface() for other in sample])
    reach = np.linalg.norm(prototype.surface(), axis=1).max()
    low, high = points.min(axis=0) - reach, points.max(axis=0) + reach
    while True:
        pose = np.eye(4)
        pose[:3, :3] = _draw_rotation(rng)
        pose[:3, 3] = rng.uniform(low, high)
        placed = Prototype(prototype.kind, prototype.dimensions, pose)
        if crosses(placed, sample, params.overlap) and _all_exposed((*sample, placed), params.exposed):
            return placed


def crosses(prototype: Prototype, sample: tuple[Prototype, ...], overlap: float) -> bool:
    """Whether the prototype's surface truly passes through that of a prototype of the sample.

    A closed surface is connected: with one point inside a solid and another outside, it passes through the solid's
    surface. Both must be `overlap` metres deep, far beyond the meshes' chord error, so what holds for the exact
    surfaces holds for the meshes. Points lie about a centimetre apart: a shallower touch may be refused, but a miss
    is never taken for a crossing.
    """

    def passes(distance: NDArray[np.float64]) -> bool:
        return bool(distance.min() < -overlap and distance.max() > overlap)

    mine = prototype.surface()
    to_sample = np.min([other.signed_distance(mine) for other in sample], axis=0)
    return passes(to_sample) or any(passes(prototype.signed_distance(other.surface())) for other in sample)


def _all_exposed(sample: tuple[Prototype, ...], share: float) -> bool:
    """Whether so large a share of every prototype's surface lies outside all others: none is swallowed."""
    for index, prototype in enumerate(sample):
        points = prototype.surface()
        others = sample[:index] + sample[index + 1 :]
        outside = np.min([other.signed_distance(points) for other in others], axis=0) > 0
        if outside.mean() < share:
            return False
    return True


def _draw_rotation(rng: np.random.Generator) -> NDArray[np.float64]:
    """(3, 3), uniform over all rotations: a unit quaternion drawn uniformly (Shoemake 1992)."""
    w, x, y, z = (q := rng.standard_normal(4)) / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
