"""A depth image and its camera: each pixel becomes a point of the camera's optical frame, row after row.

    x = (u - cx) z / fx,  y = (v - cy) z / fy,

for column u and row v, from 0 at the middle of the top left pixel. Pixels that were not measured, 0 or NaN, and those
outside a mask keep their places as missing points.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from service.clouds import npy, png
from service.clouds.claims import check_bytes, check_count, quote
from service.clouds.frame import RawCloud
from service.engine.errors import InvalidParameter, NoFinitePoints, UnreadableCloud

MILLIMETRE = 0.001
SHORTEST = 1.0  # pixels; a focal length below it is given in another unit
FARTHEST = 1e6  # pixels; as much as the longest focal length, and the principal point from the image's corner


@dataclass(frozen=True)
class DepthCamera:
    """A pinhole camera without distortion, and what its depth image counts in.

    Attributes:
        fx: focal length along rows, pixels.
        fy: focal length along columns, pixels.
        cx: column of the principal point, pixels.
        cy: row of the principal point, pixels.
        scale: metres that a depth of 1 stands for; None for 0.001 where depths are whole numbers, else 1.

    Raises:
        InvalidParameter: a number out of its range.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    scale: float | None = None

    def __post_init__(self) -> None:
        focal, centre = (self.fx, self.fy), (self.cx, self.cy)
        if not all(SHORTEST <= length <= FARTHEST for length in focal):
            raise InvalidParameter(
                f"the focal lengths fx and fy should be from 1 to {FARTHEST:g} pixels, not {focal}; multiply them by "
                "the image's width and height if they are shares of these"
            )
        if not all(abs(place) <= FARTHEST for place in centre):
            raise InvalidParameter(f"the principal point cx, cy should be within {FARTHEST:g} pixels, not {centre}")
        if self.scale is not None and not 1e-9 <= self.scale <= 1e3:
            raise InvalidParameter(
                f"the depth scale is the metres that a depth of 1 stands for, 0.001 for millimetres, not {self.scale}"
            )


def parse_camera(intrinsics: str | None, depth_scale: float | None = None) -> DepthCamera | None:
    """The camera "fx,fy,cx,cy" and its scale, as requests and the command line write them; None where there is none.

    Raises:
        InvalidParameter: it is not 4 numbers in their ranges, or a scale comes alone.
    """
    if not intrinsics:
        if depth_scale is not None:
            raise InvalidParameter("A depth scale belongs to a depth image: give its intrinsics fx,fy,cx,cy as well.")
        return None
    try:
        fx, fy, cx, cy = map(float, intrinsics.split(","))
    except ValueError:
        raise InvalidParameter(
            "The intrinsics are fx,fy,cx,cy: 4 numbers in pixels, such as 525,525,319.5,239.5; they were "
            f"{quote(intrinsics)}."
        ) from None
    return DepthCamera(fx, fy, cx, cy, depth_scale)


def read(data: bytes, max_points: int, camera: DepthCamera, mask: bytes | None = None) -> RawCloud:
    """Reads a depth image.

    Args:
        data: a PNG of 16-bit grey values, or an NPY (H, W) of whole numbers or floats.
        max_points: limit on its pixels, and on the mask's.
        camera: that took it.
        mask: a PNG of grey values, or an NPY (H, W) of bool or whole numbers: the object is where it is not 0.

    Returns:
        (H W) points in the camera's optical frame, metres.

    Raises:
        EmptyCloud, TooManyPoints: by the size that an image claims.
        NoFinitePoints: no pixel was measured, or none within the mask.
        UnreadableCloud: an image that is none, or a mask of another size.
    """
    z = _metres(_pixels(data, max_points, "this depth image"), camera)
    if np.isnan(z).all():
        raise NoFinitePoints(f"none of the {z.size} pixels of the depth image was measured: each is 0, negative or NaN")
    if mask is not None:
        z[~_read_mask(mask, z.shape, max_points)] = np.nan
        if np.isnan(z).all():
            raise NoFinitePoints("no pixel of the depth image was measured where its mask has the object (is not 0)")
    rows, columns = np.arange(z.shape[0])[:, None], np.arange(z.shape[1])
    x, y = (columns - camera.cx) * z / camera.fx, (rows - camera.cy) * z / camera.fy
    return RawCloud(np.stack([x, y, z], axis=-1).reshape(-1, 3), width=z.shape[1])


def _metres(depth: NDArray[Any], camera: DepthCamera) -> NDArray[np.float64]:
    """(H, W) depths in metres, NaN where nothing was measured."""
    whole = depth.dtype.kind in "iu"
    if depth.dtype.kind not in "fiu" or depth.dtype.itemsize < 2:
        raise UnreadableCloud(
            f"this depth image has values of type {depth.dtype}, too coarse for depths; it should be a PNG of 16-bit "
            "grey values, or an NPY of uint16 millimetres or float32 metres"
        )
    z = depth.astype(np.float64) * (camera.scale or (MILLIMETRE if whole else 1.0))
    z[~((z > 0) & (z < math.inf))] = np.nan
    return z


def _read_mask(data: bytes, shape: tuple[int, ...], max_points: int) -> NDArray[np.bool_]:
    """(H, W) where the object is."""
    mask = _pixels(data, max_points, "the mask")
    if mask.dtype.kind not in "biu":
        raise UnreadableCloud(f"the mask has values of type {mask.dtype}; it should be of bool or whole numbers")
    if mask.shape != shape:
        raise UnreadableCloud(
            f"the mask has {mask.shape[1]} x {mask.shape[0]} pixels, the depth image {shape[1]} x {shape[0]}; "
            "they should be of one size"
        )
    return mask != 0


def _pixels(data: bytes, max_points: int, where: str) -> NDArray[Any]:
    """(H, W) the values of an image in PNG or NPY."""
    if data.startswith(png.SIGNATURE):
        return png.read(data, max_points, where)
    if not data.startswith(npy.SIGNATURE):
        raise UnreadableCloud(f"{where} begins with {quote(data[:16])}; it should be a PNG or an NPY")
    layout = npy.read_layout(data[: npy.HEADER_LIMIT], where)
    if layout.dtype.kind not in "fiub" or len(layout.shape) != 2 or min(layout.shape) < 0:
        raise UnreadableCloud(
            f"{where} is an array of shape {quote(layout.shape)} and type {quote(str(layout.dtype))}; it should be of "
            "numbers, (H, W)"
        )
    check_count(math.prod(layout.shape), max_points, where)
    check_bytes(layout.size, len(data) - layout.body, where)
    return npy.to_array(memoryview(data)[layout.body :], layout)
