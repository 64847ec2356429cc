"""Grey pictures out of PNG and into it; the only module of the service that imports Pillow.

A picture is decoded once its size is within the limit, whatever else it claims.
"""

from __future__ import annotations

import io
import struct
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from service.clouds.claims import check_count, quote
from service.engine.errors import UnreadableCloud

if TYPE_CHECKING:
    from PIL.Image import Image  # else imported by those who need it: most clouds are no pictures

MEDIA_TYPE = "image/png"
SIGNATURE = b"\x89PNG\r\n\x1a\n"
_ONE_VALUE = (0, 3)  # colour types of one value a pixel: grey, and the numbers of a palette


def read(data: bytes, max_pixels: int, where: str) -> NDArray[Any]:
    """Reads a grey picture.

    Args:
        data: a PNG of grey values, or of numbers of a palette.
        max_pixels: limit on its size.
        where: begins the message of an error.

    Returns:
        (rows, columns) bool, uint8 or uint16, by its bits a pixel: 1, 2 to 8, or 16.

    Raises:
        EmptyCloud, TooManyPoints: by the size that it claims.
        UnreadableCloud: no PNG, a coloured one, or a damaged one.
    """
    if len(data) < 33 or data[:8] != SIGNATURE or data[12:16] != b"IHDR":
        raise UnreadableCloud(f"{where} is no PNG, or truncated in its header; send it again")
    columns, rows, bits, colour = struct.unpack_from(">IIBB", data, 16)
    check_count(columns * rows, max_pixels, where)
    if colour not in _ONE_VALUE:
        raise UnreadableCloud(
            f"{where} is a PNG in colour or with transparency, {bits} bits a channel; save it in grey, without alpha"
        )
    try:
        with _open(data, (columns, rows)) as picture:
            picture.verify()  # the checksums, which decoding passes over; the picture has to be opened anew then
        with _open(data, (columns, rows)) as picture:
            return np.array(picture)
    except Exception as error:  # Pillow lets errors of zlib, struct and its own through, SyntaxError among them
        raise UnreadableCloud(
            f"{where} is a PNG that is truncated or damaged ({quote(str(error), 120)}); write or send it again"
        ) from error


def _open(data: bytes, size: tuple[int, int]) -> Image:
    """Opens a picture without decoding it; a second header may not make it larger than the first."""
    from PIL import Image

    picture = Image.open(io.BytesIO(data), formats=["PNG"])
    if picture.size != size:
        raise ValueError("two headers")
    return picture


def write(image: NDArray[np.uint8]) -> bytes:
    """A grey picture (rows, columns), 0 black, as PNG."""
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(image).save(file, "PNG", optimize=True)
    return file.getvalue()
