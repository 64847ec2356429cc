"""Clouds in: the bytes of a file become a PointCloud in metres, seen from the sensor.

One module a format; each gives a RawCloud, and `frame` brings it into the sensor's frame. Whatever the bytes,
only children of ShapeConceptsError are raised, and memory follows the bytes that are there, not what they claim.
"""

from __future__ import annotations

import numpy as np

from service.clouds import depth, json_points, npy, npz, pcd, ply, pointcloud2, xyz
from service.clouds.depth import DepthCamera, parse_camera
from service.clouds.formats import FORMATS, Format, by_content, by_media_type, tell
from service.clouds.frame import ORIGIN, UNITS, RawCloud, Viewpoint, place
from service.clouds.ply import write as write_ply
from service.clouds.scene_cloud import SceneCloud
from service.engine.cloud import PointCloud
from service.engine.errors import EmptyCloud, InvalidParameter, UnreadableCloud, UnsupportedFormat

__all__ = [
    "FORMATS",
    "MAX_POINTS",
    "UNITS",
    "DepthCamera",
    "Format",
    "SceneCloud",
    "Viewpoint",
    "by_media_type",
    "parse_camera",
    "read",
    "read_scene",
    "write_ply",
]

MAX_POINTS = 5_000_000

_READERS = {
    "pcd": pcd.read,
    "ply": ply.read,
    "xyz": xyz.read,
    "npy": npy.read,
    "npz": npz.read,
    "json": json_points.read,
    "pointcloud2": pointcloud2.read,
}


def read(
    data: bytes,
    format: str | None = None,
    *,
    name: str = "",
    unit: str | None = None,
    viewpoint: Viewpoint | None = None,
    camera: DepthCamera | None = None,
    mask: bytes | None = None,
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
        camera: that took the depth image which the file is; None where it is none.
        mask: of a depth image, in PNG or NPY: the object is where it is not 0.
        max_points: limit on the points, missing ones included.

    Returns:
        The measured points, in metres and in the sensor's frame, in the order of the file.

    Raises:
        UnsupportedFormat: the format is none of FORMATS, or cannot be told.
        UnreadableCloud: truncated, damaged, or contradictory bytes.
        EmptyCloud, NoFinitePoints, TooManyPoints, ImplausibleExtent: by what the file holds.
        InvalidParameter: an unknown unit, a limit below 1, or a depth image without its camera, and the reverse.
    """
    return read_scene(
        data,
        format,
        name=name,
        unit=unit,
        viewpoint=viewpoint,
        camera=camera,
        mask=mask,
        max_points=max_points,
    ).cloud


def read_scene(
    data: bytes,
    format: str | None = None,
    *,
    name: str = "",
    unit: str | None = None,
    viewpoint: Viewpoint | None = None,
    camera: DepthCamera | None = None,
    mask: bytes | None = None,
    max_points: int = MAX_POINTS,
) -> SceneCloud:
    """Reads a cloud as `read`, with the pose of its sensor and the width of its image."""
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
        format = format or tell(data, name)
        if format == "png" or camera is not None or mask is not None:
            _check_depth(format, unit, viewpoint)
            raw = _read_depth(data, max_points, camera, mask)
        else:
            raw = _READERS[format](data, max_points)
        pose = viewpoint or raw.viewpoint or ORIGIN
        return SceneCloud(place(raw, unit, viewpoint), pose, unit or raw.unit or "m", raw.width)


def _check_depth(format: str, unit: str | None, viewpoint: Viewpoint | None) -> None:
    """Refuses what does not go with a depth image."""
    if format not in ("png", "npy"):
        raise InvalidParameter(f"intrinsics and a mask belong to a depth image, PNG or NPY; this cloud is {format}")
    if unit not in (None, "m"):
        raise InvalidParameter(f"a depth image has no unit; give a depth scale, metres of a depth of 1, not {unit!r}")
    if viewpoint not in (None, ORIGIN):
        raise InvalidParameter("a depth image is seen from its own camera; give no viewpoint with it")


def _read_depth(data: bytes, max_points: int, camera: DepthCamera | None, mask: bytes | None) -> RawCloud:
    if camera is None:
        raise InvalidParameter(
            "a depth image needs the intrinsics of its camera: fx,fy,cx,cy in pixels, such as 525,525,319.5,239.5"
        )
    return depth.read(data, max_points, camera, mask)
