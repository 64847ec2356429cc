"""The formats that clouds come in, and how one is told: by content first, then by name."""

from __future__ import annotations

import re
from typing import NamedTuple

from service.clouds.claims import quote
from service.engine.errors import UnsupportedFormat


class Format(NamedTuple):
    """One format of clouds.

    Attributes:
        name: as `read` takes it.
        title: what people call it, and which variants are read.
        endings: endings of file names, lower case, with the dot.
        media_types: the first is the one to send.
    """

    name: str
    title: str
    endings: tuple[str, ...]
    media_types: tuple[str, ...]


FORMATS: dict[str, Format] = {
    entry.name: entry
    for entry in (
        Format(
            "pcd",
            "PCD 0.5 to 0.7: ascii, binary, binary_compressed",
            (".pcd",),
            ("model/x-pcd", "application/x-pcd", "application/vnd.pcd"),
        ),
        Format(
            "ply",
            "PLY: ascii, binary little and big endian",
            (".ply",),
            ("model/ply", "application/ply", "application/x-ply"),
        ),
        Format(
            "xyz",
            "text, one point a line: x y z, separated by blanks, commas or semicolons",
            (".xyz", ".txt", ".csv", ".asc", ".pts"),
            ("text/plain", "text/csv", "chemical/x-xyz"),
        ),
        Format(
            "npy",
            "NumPy array (N, 3+), (H, W, 3+), with fields x, y, z, or a depth image (H, W)",
            (".npy",),
            ("application/x-npy",),
        ),
        Format("npz", "NumPy archive that holds such an array", (".npz",), ("application/x-npz",)),
        Format(
            "json",
            'JSON: [[x, y, z], ...] or {"points": [[x, y, z], ...]}, null where nothing was measured',
            (".json",),
            ("application/json",),
        ),
        Format("png", "depth image: PNG, 16-bit grey, with its intrinsics", (".png",), ("image/png",)),
        Format(
            "pointcloud2",
            "ROS 2 sensor_msgs/msg/PointCloud2 in CDR",
            (".cdr",),
            ("application/x-ros-cdr", "application/cdr"),
        ),
    )
}

BESIDE = {".csv", ".json", ".png"}  # tables, manifests and pictures stand beside clouds, though clouds may end so
CLOUD_ENDINGS = {ending for entry in FORMATS.values() for ending in entry.endings} - BESIDE
"""What the files of clouds end in, where others lie beside them."""

# Media types that clients send when they do not know better: the content decides.
ANY_MEDIA_TYPES = ("", "application/octet-stream", "application/x-www-form-urlencoded", "text/plain")

_MAGIC = {
    "ply": re.compile(rb"ply[ \t]*[\r\n]"),
    "npy": re.compile(rb"\x93NUMPY"),
    "png": re.compile(rb"\x89PNG\r\n\x1a\n"),
    "npz": re.compile(rb"PK(?:\x03\x04|\x05\x06)"),
    "json": re.compile(rb"(?:\xef\xbb\xbf)?\s*(?:\{\s*\"|\[\s*(?:\[|null|\]))"),
    "pcd": re.compile(rb"(?:# \.PCD|(?:#[^\n]*\n|\s)*(?:VERSION|FIELDS|COLUMNS)[ \t])"),
}
# CDR has no signature: the stamp, a name of a frame, and soon a field x tell it, in either byte order.
_MAGIC["pointcloud2"] = re.compile(
    rb"\x00(?:\x01.{10}[\x01-\xff]\x00{3}|\x00.{10}\x00{3}[\x01-\xff])[^\x00]{0,254}\x00"
    rb".{1,2000}?(?:\x02\x00{3}|\x00{3}\x02)x\x00",
    re.DOTALL,
)
_NUMBER = rb"[-+]?(?:nan|inf|(?:\d+(?:\.\d*)?|\.\d+)(?:e[-+]?\d+)?)"
_TEXT_POINT = re.compile(
    rb"(?:^|\n)[ \t]*" + _NUMBER + (rb"(?:[ \t]*[,;][ \t]*|[ \t]+)" + _NUMBER) * 2 + rb"(?=[\s,;#/]|$)", re.IGNORECASE
)


def by_content(data: bytes) -> str | None:
    """The format whose signature the bytes bear, or None: xyz text has none."""
    head = data[: 1 << 14]
    return next((name for name, magic in _MAGIC.items() if magic.match(head)), None)


def by_media_type(media_type: str) -> str | None:
    """The format that a media type names; None when the content has to tell.

    Args:
        media_type: as in a Content-Type header; parameters after ";" are ignored, but for CDR, which has none or
            names the type of the message.

    Raises:
        UnsupportedFormat: it names something that is not read here.
    """
    bare, _, parameters = media_type.partition(";")
    bare = bare.strip().lower()
    if bare in ANY_MEDIA_TYPES:
        return None
    for entry in FORMATS.values():
        if bare in entry.media_types:
            if entry.name == "pointcloud2" and parameters.strip() and "PointCloud2" not in parameters:
                raise UnsupportedFormat(
                    f"of the messages of ROS, PointCloud2 is read, not {quote(parameters.strip())}; "
                    f"send {bare}; type=sensor_msgs/msg/PointCloud2"
                )
            return entry.name
    known = ", ".join(f"{entry.media_types[0]} ({entry.name})" for entry in FORMATS.values())
    raise UnsupportedFormat(
        f"no format has the media type {quote(bare)}; send {known}, or application/octet-stream: the content tells"
    )


def tell(data: bytes, name: str = "") -> str:
    """The format of a cloud: by its content, else by the ending of its name, else xyz if it reads like points.

    Raises:
        UnsupportedFormat: nothing tells it.
    """
    if known := by_content(data):
        return known
    ending = name[name.rfind(".") :].lower() if "." in name else ""
    for entry in FORMATS.values():
        if ending in entry.endings:
            return entry.name
    if _TEXT_POINT.search(data[: 1 << 14]):
        return "xyz"
    formats = "; ".join(f"{entry.name} ({entry.title})" for entry in FORMATS.values())
    raise UnsupportedFormat(
        f"neither the content, which begins with {quote(data[:16])}, nor the name {quote(name)} "
        f"is of a format that is read here; these are: {formats}"
    )
