"""ROS 2's sensor_msgs/msg/PointCloud2 in CDR, as a robot publishes it; no ROS is needed. Only here is rosbags imported.

Nothing is copied but x, y and z.
"""

from __future__ import annotations

import struct
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from service.clouds.claims import check_bytes, check_count, quote
from service.clouds.frame import RawCloud
from service.engine.errors import UnreadableCloud

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

TYPE = "sensor_msgs/msg/PointCloud2"
MOST_FIELDS = 256
_KINDS = {7: "f4", 8: "f8"}  # PointField's FLOAT32 and FLOAT64


class Origin(NamedTuple):
    """Where and when a message says that its cloud was measured.

    Attributes:
        frame_id: name of the frame that its coordinates are given in.
        stamp_ns: nanoseconds since the epoch of the robot's clock.
    """

    frame_id: str
    stamp_ns: int


def read(data: bytes, max_points: int) -> RawCloud:
    """Reads x, y, z of a message, organised or not, row after row.

    Raises:
        EmptyCloud, TooManyPoints: by its width and height.
        UnreadableCloud: no such message, or one that contradicts itself.
    """
    return read_with_origin(data, max_points)[0]


def read_with_origin(data: bytes, max_points: int) -> tuple[RawCloud, Origin]:
    """Reads a message as `read` does, and its header."""
    message = _deserialise(data)
    check_count(message.width * message.height, max_points, "this PointCloud2")
    _check_steps(message)
    points = np.stack([_axis(message, axis) for axis in "xyz"], axis=-1).reshape(-1, 3)
    return RawCloud(points, width=message.width if message.height > 1 else None), _origin(message)


def read_origin(data: bytes) -> Origin:
    """Reads a message's header alone; raises UnreadableCloud where it is none."""
    return _origin(_deserialise(data))


def _origin(message: Any) -> Origin:
    stamp = message.header.stamp
    return Origin(message.header.frame_id, stamp.sec * 1_000_000_000 + stamp.nanosec)


@cache
def _types() -> Typestore:
    """The messages of ROS 2; PointCloud2 is the same in all of its releases."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


def _deserialise(data: bytes) -> Any:
    """The message, its data a view of the bytes.

    Raises:
        UnreadableCloud: the bytes are none.
    """
    try:
        fields = _claimed_fields(data)
        if fields > MOST_FIELDS:  # each would become an object
            raise ValueError(f"{fields} fields, more than {MOST_FIELDS}")
        return _types().deserialize_cdr(memoryview(data), TYPE)
    except Exception as error:  # SerdeError, and what it may let through
        raise UnreadableCloud(
            f"PointCloud2: the bytes are no {TYPE} in CDR ({quote(str(error), 120)}); "
            "they are truncated, damaged, or another message"
        ) from error


def _claimed_fields(data: bytes) -> int:
    """How many fields a message promises: after its encapsulation, stamp, frame_id, height and width."""
    order = "<" if data[1:2] == b"\x01" else ">"
    (length,) = struct.unpack_from(order + "I", data, 12)
    return int(struct.unpack_from(order + "8xI", data, (16 + length + 3) // 4 * 4)[0])


def _check_steps(message: Any) -> None:
    """Refuses a message whose sizes contradict each other."""
    if message.row_step < message.width * message.point_step:
        raise UnreadableCloud(
            f"PointCloud2: its row_step of {message.row_step} bytes is less than its width {message.width} times its "
            f"point_step {message.point_step}; the publisher fills in one of them wrong"
        )
    check_bytes(message.row_step * message.height, len(message.data), "PointCloud2")


def _axis(message: Any, axis: str) -> NDArray[np.float64]:
    """(height, width) x, y or z."""
    field = next((field for field in message.fields if field.name == axis), None)
    if field is None:
        names = [field.name for field in message.fields]
        raise UnreadableCloud(f"PointCloud2: none of its fields {quote(names)} is {axis}; a cloud has x, y and z")
    if field.datatype not in _KINDS or field.count > 1:
        raise UnreadableCloud(
            f"PointCloud2: its field {axis} is of datatype {field.datatype}, {field.count} values; it should be one of "
            "FLOAT32 (7) or FLOAT64 (8)"
        )
    kind = np.dtype((">" if message.is_bigendian else "<") + _KINDS[field.datatype])
    if field.offset + kind.itemsize > message.point_step:
        raise UnreadableCloud(
            f"PointCloud2: its field {axis} at offset {field.offset} ends beyond its point_step of "
            f"{message.point_step} bytes; the publisher fills in one of them wrong"
        )
    shape, steps = (message.height, message.width), (message.row_step, message.point_step)
    return np.ndarray(shape, kind, message.data, field.offset, steps).astype(np.float64)
