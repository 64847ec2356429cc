"""Tensors as the protocol names and packs them."""

from __future__ import annotations

import struct
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

DTYPES: dict[str, Any] = {"BOOL": "?", "INT64": "<i8", "FP32": "<f4", "FP64": "<f8", "BYTES": object}


class Tensor(NamedTuple):
    """A named array.

    Attributes:
        name: of the input or output.
        datatype: a name in DTYPES.
        values: of that type; texts where it is BYTES.
    """

    name: str
    datatype: str
    values: NDArray[Any]


def tensor(name: str, datatype: str, values: ArrayLike) -> Tensor:
    """A tensor of values."""
    return Tensor(name, datatype, np.asarray(values, DTYPES[datatype]))


def to_bytes(given: Tensor) -> bytes:
    """The binary form: little-endian, row after row; each text after its length, a uint32."""
    if given.datatype != "BYTES":
        return given.values.tobytes()
    texts = [text.encode() for text in given.values.tolist()]
    return b"".join(struct.pack("<I", len(text)) + text for text in texts)
