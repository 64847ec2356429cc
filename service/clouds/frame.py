"""From the coordinates of a file to the sensor's frame: units, the sensor's pose, and what counts as missing."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from service.clouds.claims import quote
from service.engine.cloud import PointCloud
from service.engine.errors import ImplausibleExtent, InvalidParameter, NoFinitePoints

UNITS = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "um": 1e-6, "in": 0.0254, "ft": 0.3048}  # metres


def _numbers(given: object, count: int, what: str) -> tuple[float, ...]:
    """`count` finite floats, or InvalidParameter."""
    try:
        numbers = tuple(float(part) for part in given)  # type: ignore[attr-defined]  # anything may come from a caller
    except (TypeError, ValueError, OverflowError):
        numbers = ()
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise InvalidParameter(f"the viewpoint's {what} should be {count} finite numbers, not {quote(given)}")
    return numbers


@dataclass(frozen=True)
class Viewpoint:
    """The sensor's pose in the frame that a cloud's coordinates are given in.

    Attributes:
        position: (3,) where the sensor stood, in the cloud's own unit.
        orientation: (w, x, y, z), a quaternion that turns the sensor's axes (x right, y down, z forward)
            into the cloud's; of any length but 0.

    Raises:
        InvalidParameter: other than 3 and 4 finite numbers, or a quaternion of no direction.
    """

    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    orientation: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", _numbers(self.position, 3, "position (x, y, z)"))
        object.__setattr__(self, "orientation", _numbers(self.orientation, 4, "orientation (w, x, y, z)"))
        if not 1e-6 < math.hypot(*self.orientation) < 1e6:
            raise InvalidParameter(
                f"the viewpoint's orientation {self.orientation} is no rotation; "
                "give a unit quaternion (w, x, y, z), such as (1, 0, 0, 0) for none"
            )

    @property
    def rotation(self) -> NDArray[np.float64]:
        """(3, 3): its columns are the sensor's axes in the cloud's frame."""
        norm = math.hypot(*self.orientation)
        w, x, y, z = (part / norm for part in self.orientation)
        return np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )


ORIGIN = Viewpoint()


class RawCloud(NamedTuple):
    """What a file says, before it is brought into the sensor's frame.

    Attributes:
        xyz: (N, 3) float64, the file's frame and unit; NaN or infinite where nothing was measured.
        viewpoint: the file's own word on where the sensor stood, if it has one.
        unit: the file's own word on its unit, one of UNITS, if it has one.
        width: points in a row, where the file is an image row by row.
    """

    xyz: NDArray[np.float64]
    viewpoint: Viewpoint | None = None
    unit: str | None = None
    width: int | None = None


def place(raw: RawCloud, unit: str | None, viewpoint: Viewpoint | None) -> PointCloud:
    """Drops what was not measured and brings the rest into the sensor's frame, in metres.

    A point p becomes R^T (p - t), for the sensor's position t and rotation R.

    Args:
        raw: the file's points.
        unit: one of UNITS, of the points and of the viewpoint's position; overrides the file's own, metres if it has
            none.
        viewpoint: overrides the file's own.

    Raises:
        NoFinitePoints: no point is a measurement.
        ImplausibleExtent: a coordinate too large for float32 metres.
    """
    pose = viewpoint or raw.viewpoint or ORIGIN
    unit = unit or raw.unit or "m"
    with np.errstate(over="ignore"):  # a position beyond float32 is no point's
        kept = _measured(raw.xyz, np.array(pose.position, np.float32))
    whole = bool(kept.all())
    measured = raw.xyz if whole else raw.xyz[kept]
    if not len(measured):
        raise NoFinitePoints(
            f"none of the {len(raw.xyz)} points is a measurement: each is NaN, infinite, or (0, 0, 0) for "
            "nothing returned; check what the sensor saw and how the cloud was cut out"
        )
    with np.errstate(over="ignore", invalid="ignore"):
        points = _into_sensor_frame(measured, pose)
        points = points if unit == "m" else points * UNITS[unit]
    largest = max(points.max(), -points.min())
    if not largest <= np.finfo(np.float32).max:
        raise ImplausibleExtent(
            f"a coordinate of {largest:.3g} m is beyond any sensor; check the unit ({unit}) and the values"
        )
    return PointCloud(points.astype(np.float32), None if whole else kept)


@njit(cache=True, nogil=True)
def _measured(xyz: NDArray[np.float64], position: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(N,) which points the sensor measured.

    Depth cameras write a missing return as NaN or as (0, 0, 0). The latter surely is one where the sensor
    itself stands (no sensor measures its own centre, to float32), and where it repeats: two samples of a
    surface do not fall on the same exact zero. A single (0, 0, 0) away from the sensor stays.
    """
    out = np.empty(len(xyz), np.bool_)
    zeros = 0
    for i in range(len(xyz)):
        x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        finite = np.isfinite(x) and np.isfinite(y) and np.isfinite(z)
        at_sensor = np.float32(x) == position[0] and np.float32(y) == position[1] and np.float32(z) == position[2]
        zeros += x == 0 and y == 0 and z == 0
        out[i] = finite and not at_sensor
    if zeros > 1:
        for i in range(len(xyz)):
            out[i] = out[i] and not (xyz[i, 0] == 0 and xyz[i, 1] == 0 and xyz[i, 2] == 0)
    return out


def _into_sensor_frame(xyz: NDArray[np.float64], pose: Viewpoint) -> NDArray[np.float64]:
    """(N, 3) R^T (p - t), written out: a matrix product may round a point by its place in the array."""
    if pose == ORIGIN:
        return xyz
    x, y, z = (xyz - np.array(pose.position)).T
    return np.stack([x * axis[0] + y * axis[1] + z * axis[2] for axis in pose.rotation.T], axis=1)
