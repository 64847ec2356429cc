"""What is found in a scene: a plane, the objects that stand on it, and what is neither."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from service.engine.params import StageParams


class TabletopParams(StageParams):
    """What is taken for a table, and what for an object on it."""

    reach: float = Field(10.0, gt=0, le=20, description="points farther from the sensor are left out, metres")
    voxel: float = Field(0.005, ge=0.002, le=0.1, description="edge of the voxels that are looked at, metres")
    max_voxels: int = Field(150_000, ge=1000, le=1_000_000, description="beyond, larger voxels are taken: bounds work")
    hypotheses: int = Field(400, ge=10, le=10_000, description="planes that are tried for each one that is found")
    planes: int = Field(3, ge=1, le=10, description="largest planes among which the supporting one is looked for")
    min_plane: float = Field(0.1, gt=0, le=1, description="least share of the scene's voxels that makes a plane")
    min_width: float = Field(0.1, gt=0, description="smallest plane across, metres")
    margin: float = Field(0.02, ge=0, description="how far an object may reach over the plane's edge, metres")
    max_height: float = Field(1.0, gt=0, description="points higher above the plane are left out, metres")
    gap: float = Field(0.015, gt=0, description="pieces less far apart are one object, metres; twice it: they touch")
    foot: float = Field(0.1, gt=0, description="pieces that begin higher, over ground that is seen, float, metres")
    min_rise: float = Field(0.01, gt=0, description="least height of an object above the plane, metres")
    min_points: int = Field(100, ge=10, description="fewest points of an object")
    min_extent: float = Field(0.02, gt=0, description="least length of an object, metres")
    max_extent: float = Field(1.0, gt=0, description="greatest length of an object, metres")


@dataclass(frozen=True)
class Plane:
    """A plane n.p + d = 0 in the sensor's frame.

    Attributes:
        normal: (3,) float64, unit length, towards the side on which the sensor is.
        offset: d, metres: the sensor's height above the plane.
        band: half the thickness of the layer that is taken for the plane, metres.
    """

    normal: NDArray[np.float64]
    offset: float
    band: float

    def heights(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Signed distances (N,) of points (N, 3) from the plane, metres; positive on the sensor's side."""
        x, y, z = points.T
        return x * self.normal[0] + y * self.normal[1] + z * self.normal[2] + self.offset

    @property
    def basis(self) -> NDArray[np.float64]:
        """(2, 3): two directions along the plane, at right angles."""
        along = np.cross(self.normal, np.eye(3)[np.argmin(np.abs(self.normal))])
        along /= np.linalg.norm(along)
        return np.stack([along, np.cross(self.normal, along)])


class Box(NamedTuple):
    """The smallest box around an object that stands upright on the plane.

    Attributes:
        centre: (3,) float64, metres, sensor's frame.
        axes: (3, 3) float64: rows are the directions of length, width and height, right-handed; height is the
            plane's normal.
        size: (3,) float64, metres: length >= width along the plane, and height.
    """

    centre: NDArray[np.float64]
    axes: NDArray[np.float64]
    size: NDArray[np.float64]


@dataclass(frozen=True)
class SceneObject:
    """An object that stands on the plane.

    Attributes:
        indices: (K,) int64, ascending: its points, as rows of the scene's cloud.
        centroid: (3,) float64, metres, sensor's frame: the mean of its voxels, so that near sides do not outweigh.
        box: around all its points.
        height: of its lowest and highest point above the plane (2,), metres.
        touches: numbers of the objects that are less than two gaps away.
        hidden_by: numbers of nearer objects that are seen right beside it, so that they may hide a part of it.
        at_border: whether it reaches the border of the image, so that a part may be missing; None where the cloud
            is no image.
        beyond_edge: whether something that is not above the plane adjoins it, so that it may be cut.
    """

    indices: NDArray[np.int64]
    centroid: NDArray[np.float64]
    box: Box
    height: NDArray[np.float64]
    touches: tuple[int, ...]
    hidden_by: tuple[int, ...]
    at_border: bool | None
    beyond_edge: bool


class LeftOut(NamedTuple):
    """Points that are part of no object, for one reason.

    Attributes:
        reason: a name of REASONS.
        points: how many points.
        pieces: how many connected pieces they make; 0 where that was not looked at.
    """

    reason: str
    points: int
    pieces: int


@dataclass(frozen=True)
class Scene:
    """A plane and what stands on it.

    Attributes:
        plane: the supporting plane.
        inliers: points that are part of it.
        objects: nearest to the sensor first.
        left_out: for every reason that occurred, in the order of REASONS; with the plane's and the objects' points,
            these are all points of the cloud.
        warnings: what is odd about the scene, in sentences.
    """

    plane: Plane
    inliers: int
    objects: tuple[SceneObject, ...]
    left_out: tuple[LeftOut, ...]
    warnings: tuple[str, ...]


REASONS = {
    "far": "farther from the sensor than is looked at",
    "below": "below the plane, or behind it",
    "high": "higher above the plane than is looked at",
    "beside": "above the plane's level but not over it",
    "afloat": "over the plane but not standing on it",
    "small": "too small or of too few points for an object",
    "large": "too large for an object",
    "many": "objects beyond the number that is answered",
}
