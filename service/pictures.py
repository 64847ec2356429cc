"""Small pictures as PNG, without a library for images."""

from __future__ import annotations

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

MEDIA_TYPE = "image/png"
_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_GREY_8_BIT = b"\x08\x00\x00\x00\x00"  # depth, colour type, compression, filter, no interlace


def png(image: NDArray[np.uint8]) -> bytes:
    """A grey image (rows, columns), 0 black, as PNG (RFC 2083)."""
    rows, columns = image.shape
    lines = np.insert(image, 0, 0, axis=1).tobytes()  # each row begins with its filter: 0 for none
    chunks = (
        (b"IHDR", struct.pack(">II", columns, rows) + _GREY_8_BIT),
        (b"IDAT", zlib.compress(lines, 9)),
        (b"IEND", b""),
    )
    return _SIGNATURE + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )
