"""Clouds in: the bytes of a file become a PointCloud in metres, seen from the sensor.

One module a format; each gives a RawCloud, and `frame` brings it into the sensor's frame. Whatever the bytes,
only children of ShapeConceptsError are raised, and memory follows the bytes that are there, not what they claim.
"""

from __future__ import annotations

import numpy as np

from service.clouds import json_points, npy, npz, pcd, ply, xyz
from service.clouds.formats import FORMATS, Format, by_content, by_media_type, tell
from service.clouds.frame import UNITS, Viewpoint, place
from service.clouds.ply import write as write_ply
from service.engine.cloud import PointCloud
from service.engine.errors import EmptyCloud, InvalidParameter, UnreadableCloud, UnsupportedFormat

__all__ = ["FORMATS", "MAX_POINTS", "UNITS", "Format", "Viewpoint", "by_media_type", "read", "write_ply"]

MAX_POINTS = 5_000_000

_READERS = {
    "pcd": pcd.read,
    "ply": ply.read,
    "xyz": xyz.read,
    "npy": npy.read,
    "npz": npz.read,
    "json": json_points.read,
}


def read(
    data: bytes,
    format: str | None = None,
    *,
    name: str = "",
    unit: str | None = None,
    viewpoint: Viewpoint | None = None,
    max_points: int = MAX_POINTS,
) -> PointCloud:
    """Reads a cloud.

    Args:
        data: the file's bytes.
        format: a name in FORMATS; None to tell it by the content, then by the ending of `name`.
        name: the file's name, if it has one.
        unit: of the coordinates and of the viewpoint's position, one of UNITS; overrides JSON's "unit". Without
            either, they are metres.
        viewpoint: the sensor's pose in the cloud's frame; overrides PCD's VIEWPOINT and JSON's "viewpoint". Without
            any, the sensor is the origin.
        max_points: limit on the points, missing ones included.

    Returns:
        The measured points, in metres and in the sensor's frame, in the order of the file.

    Raises:
        UnsupportedFormat: the format is none of FORMATS, or cannot be told.
        UnreadableCloud: truncated, damaged, or contradictory bytes.
        EmptyCloud, NoFinitePoints, TooManyPoints, ImplausibleExtent: by what the file holds.
        InvalidParameter: an unknown unit, or a limit below 1.
    """
    if format is not None and format not in FORMATS:
        raise UnsupportedFormat(f"the format {format!r} is unknown; it is one of {', '.join(FORMATS)}")
    if unit is not None and unit not in UNITS:
        raise InvalidParameter(f"the unit {unit!r} is unknown; it is one of {', '.join(UNITS)}")
    if max_points < 1:
        raise InvalidParameter(f"max_points should be at least 1, not {max_points}")
    if not data:
        raise EmptyCloud("the file is empty; send the bytes of a cloud")
    found = by_content(data)
    if format is not None and found not in (None, format):
        raise UnreadableCloud(f"it was sent as {format}, but its content is {found}; send it as {found}")
    with np.errstate(all="ignore"):  # signalling NaNs and overflow: what is not finite is dropped or refused
        return place(_READERS[format or tell(data, name)](data, max_points), unit, viewpoint)
