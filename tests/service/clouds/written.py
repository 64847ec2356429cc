"""Files as others would write them, byte by byte, for the tests of the readers."""

from __future__ import annotations

import io
import json
import struct
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

Points = NDArray[np.float32]


def some_points(count: int = 200, seed: int = 0) -> Points:
    """(count, 3) in a box in front of the sensor."""
    return np.random.default_rng(seed).uniform((-0.2, -0.1, 0.6), (0.2, 0.1, 0.9), (count, 3)).astype(np.float32)


def rows_of(points: Points, separator: str = " ") -> bytes:
    return "".join(separator.join(repr(float(value)) for value in point) + "\n" for point in points).encode()


def pcd_header(points: int, encoding: str, **changed: Any) -> bytes:
    """A header of x, y, z as floats; keyword arguments replace a line, or with None leave it out."""
    lines = {
        "VERSION": "0.7",
        "FIELDS": "x y z",
        "SIZE": "4 4 4",
        "TYPE": "F F F",
        "COUNT": "1 1 1",
        "WIDTH": points,
        "HEIGHT": 1,
        "VIEWPOINT": "0 0 0 1 0 0 0",
        "POINTS": points,
        "DATA": encoding,
    } | changed
    said = "".join(f"{word} {value}\n" for word, value in lines.items() if value is not None)
    return b"# .PCD v0.7 - Point Cloud Data file format\n" + said.encode()


def pcd(points: Points, encoding: str = "binary", **changed: Any) -> bytes:
    bodies = {
        "ascii": lambda: rows_of(points),
        "binary": lambda: points.astype("<f4").tobytes(),
        "binary_compressed": lambda: lzf_block(points.T.astype("<f4").tobytes()),
    }
    return pcd_header(len(points), encoding, **changed) + bodies[encoding]()


def lzf_block(plain: bytes) -> bytes:
    """PCD's compressed block, in literal runs alone."""
    packed = b"".join(bytes([len(plain[i : i + 32]) - 1]) + plain[i : i + 32] for i in range(0, len(plain), 32))
    return struct.pack("<II", len(packed), len(plain)) + packed


def ply_header(count: int, encoding: str, kind: str = "float", more: str = "") -> bytes:
    coordinates = "".join(f"property {kind} {axis}\n" for axis in "xyz")
    return f"ply\nformat {encoding} 1.0\nelement vertex {count}\n{coordinates}{more}end_header\n".encode()


def ply(points: Points, encoding: str = "binary_little_endian") -> bytes:
    bodies = {
        "ascii": lambda: rows_of(points),
        "binary_little_endian": lambda: points.astype("<f4").tobytes(),
        "binary_big_endian": lambda: points.astype(">f4").tobytes(),
    }
    return ply_header(len(points), encoding) + bodies[encoding]()


def npy(array: NDArray[Any]) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def npy_header(shape: tuple[int, ...], descr: Any = "<f4") -> bytes:
    """A header that promises what need not follow."""
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": descr, "fortran_order": False, "shape": shape})
    return stream.getvalue()


def npz(compressed: bool = False, **arrays: NDArray[Any]) -> bytes:
    stream = io.BytesIO()
    (np.savez_compressed if compressed else np.savez)(stream, **arrays)
    return stream.getvalue()


def json_points(points: Points) -> list[list[float | None]]:
    """The points as JSON has them: it knows no NaN and no infinity."""
    return [[float(value) if np.isfinite(value) else None for value in point] for point in points]


def chunk(kind: bytes, data: bytes) -> bytes:
    """A chunk of a PNG."""
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


# Adam7: first row, first column, and the steps of each pass.
PASSES = ((0, 0, 8, 8), (0, 4, 8, 8), (4, 0, 8, 4), (0, 2, 4, 4), (2, 0, 4, 2), (0, 1, 2, 2), (1, 0, 2, 1))


def png(pixels: NDArray[Any], colour: int = 0, palette: bool = False, interlaced: bool = False) -> bytes:
    """A picture (rows, columns) or (rows, columns, channels) of uint8 or uint16, of one of PNG's colour types."""
    rows, columns = pixels.shape[:2]
    passes = [pixels[r::dr, c::dc] for r, c, dr, dc in PASSES] if interlaced else [pixels]
    lines = b"".join(
        b"\0" + line.astype(line.dtype.newbyteorder(">")).tobytes() for each in passes for line in each if line.size
    )
    header = struct.pack(">IIBBBBB", columns, rows, pixels.dtype.itemsize * 8, colour, 0, 0, interlaced)
    colours = chunk(b"PLTE", bytes(range(30))) if palette else b""
    body = chunk(b"IHDR", header) + colours + chunk(b"IDAT", zlib.compress(lines)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + body


ROS = get_typestore(Stores.ROS2_HUMBLE)


def pointcloud2(points: NDArray[Any], *, little: bool = True, kind: str = "<f4", **changed: Any) -> bytes:
    """A message of ROS whose points (N, 3) or (H, W, 3) lie between an intensity and a ring, as a lidar has them.

    Keyword arguments replace a member of the message; `little` is CDR's byte order, `kind` that of the coordinates.
    """
    size, height, width = np.dtype(kind).itemsize, points.shape[0] if points.ndim == 3 else 1, points.shape[-2]
    record = np.dtype(
        {
            "names": [*"ixyzr"],
            "formats": ["<f4", *[kind] * 3, "<u2"],
            "offsets": [0, *range(8, 8 + 3 * size, size), 8 + 3 * size],
            "itemsize": 16 + 3 * size,
        }
    )
    rows = np.zeros((height, width), record)
    for axis, values in zip("xyz", np.moveaxis(points.reshape(height, width, 3), -1, 0), strict=True):
        rows[axis] = values
    field = ROS.types["sensor_msgs/msg/PointField"]
    datatypes = {"f4": 7, "f8": 8, "u2": 4}
    members = {
        "header": ROS.types["std_msgs/msg/Header"](ROS.types["builtin_interfaces/msg/Time"](1_700_000_000, 5), "lidar"),
        "height": height,
        "width": width,
        "fields": [
            field(name, record.fields[short][1], datatypes[record[short].str[1:]], 1)
            for short, name in zip("ixyzr", ("intensity", "x", "y", "z", "ring"), strict=True)
        ],
        "is_bigendian": kind.startswith(">"),
        "point_step": record.itemsize,
        "row_step": width * record.itemsize,
        "data": np.frombuffer(rows.tobytes(), np.uint8),
        "is_dense": True,
    } | changed
    name = "sensor_msgs/msg/PointCloud2"
    return bytes(ROS.serialize_cdr(ROS.types[name](**members), name, little_endian=little))


def every_kind(points: Points) -> dict[str, bytes]:
    """The same cloud in every format and encoding; the key begins with the format's name."""
    return {
        "pcd ascii": pcd(points, "ascii"),
        "pcd binary": pcd(points, "binary"),
        "pcd compressed": pcd(points, "binary_compressed"),
        "ply ascii": ply(points, "ascii"),
        "ply little": ply(points, "binary_little_endian"),
        "ply big": ply(points, "binary_big_endian"),
        "xyz blanks": rows_of(points),
        "xyz commas": rows_of(points, ","),
        "npy": npy(points),
        "npz stored": npz(points=points),
        "npz deflated": npz(True, points=points),
        "pointcloud2 little": pointcloud2(points),
        "pointcloud2 big": pointcloud2(points, little=False, kind=">f8"),
        "json list": json.dumps(json_points(points)).encode(),
        "json object": json.dumps({"viewpoint": None, "points": json_points(points)}, indent=1).encode(),
    }
