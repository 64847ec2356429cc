"""A JSON list of clouds, cut into the texts of the clouds without being parsed: each is read when its turn comes."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from service.engine.errors import UnreadableCloud

_WHAT = "several clouds are [cloud, cloud, ...], each as it would be sent alone"
_BLANKS = b" \t\r\n"


def split(data: bytes, most: int) -> list[bytes]:
    """The texts of the elements of a JSON list; that they are JSON is for whoever reads them.

    Args:
        data: the list.
        most: how many elements are cut out; the rest is left in the last one.

    Raises:
        UnreadableCloud: it is no list, or an empty one, or does not end.
    """
    text = data.removeprefix(b"\xef\xbb\xbf").strip(_BLANKS)
    if text[:1] != b"[":
        raise UnreadableCloud(f"JSON: it should begin with a bracket; {_WHAT}")
    cuts, end = _cuts(np.frombuffer(text, np.uint8), most - 1)
    if end != len(text):
        fault = "something follows its list" if end > 0 else "its list does not end: it was cut off"
        raise UnreadableCloud(f"JSON: {fault}; {_WHAT}")
    if not text[1:-1].strip(_BLANKS):
        raise UnreadableCloud(f"JSON: its list is empty; {_WHAT}")
    starts = [1, *(cut + 1 for cut in cuts.tolist())]
    ends = [*cuts.tolist(), len(text) - 1]
    return [text[start:end].strip(_BLANKS) for start, end in zip(starts, ends, strict=True)]


@njit(cache=True, nogil=True)
def _cuts(text: NDArray[np.uint8], most: int) -> tuple[NDArray[np.int64], int]:
    """Places of the first commas of the list that begins the text, and where it ends; -1 if it does not."""
    cuts = np.empty(most, np.int64)
    count = 0
    depth = 0
    quoted = False
    escaped = False
    for at in range(text.size):
        octet = text[at]
        if quoted:
            if escaped:
                escaped = False
            elif octet == 92:  # backslash
                escaped = True
            elif octet == 34:  # quotation mark
                quoted = False
        elif octet == 34:
            quoted = True
        elif octet == 91 or octet == 123:  # opening bracket or brace
            depth += 1
        elif octet == 93 or octet == 125:
            depth -= 1
            if depth == 0:
                return cuts[:count], at + 1
        elif octet == 44 and depth == 1 and count < most:  # comma
            cuts[count] = at
            count += 1
    return cuts[:count], -1
