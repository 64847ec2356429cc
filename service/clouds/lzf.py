"""LZF, the compression inside PCD's binary_compressed.

Written here because the bindings on PyPI are source-only or a lone fork, and Numba is at hand anyway.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from service.engine.errors import UnreadableCloud

BEST_RATIO = 264 / 3  # a back reference of three bytes stands for at most 264


def decompress(packed: bytes, size: int, whole: int, where: str) -> NDArray[np.uint8]:
    """Unpacks the first `size` bytes of what `packed` holds.

    Args:
        packed: the compressed bytes.
        size: how many bytes are wanted.
        whole: how many bytes `packed` is claimed to hold; checked against what LZF can reach at all.
        where: begins the message of an error.

    Raises:
        UnreadableCloud: `packed` cannot hold as much, ends early, or refers to before its start.
    """
    if whole > len(packed) * BEST_RATIO:
        raise UnreadableCloud(
            f"{where}: {len(packed)} compressed bytes cannot unfold to the {whole} that are promised; "
            "the file is truncated, or its header wrong: write or send it again"
        )
    target = np.empty(size, np.uint8)
    written = _decode(np.frombuffer(packed, np.uint8), target)
    if written < size:
        raise UnreadableCloud(
            f"{where}: the compressed data is damaged after {written} of {size} bytes; write or send it again"
        )
    return target


@njit(cache=True, nogil=True)
def _decode(source: NDArray[np.uint8], target: NDArray[np.uint8]) -> int:
    """Fills `target`; returns how many bytes were written before an error, all of them without."""
    read = 0
    written = 0
    while written < target.size:
        if read >= source.size:
            return written
        control: Any = np.int64(source[read])
        read += 1
        if control < 32:  # a run of literal bytes
            run = control + 1
            if read + run > source.size:
                return written
            kept = min(run, target.size - written)
            for k in range(kept):
                target[written + k] = source[read + k]
            read += run
            written += kept
            continue
        run = (control >> 5) + 2  # a back reference, which may overlap what it writes
        if run == 9:
            if read >= source.size:
                return written
            more: Any = np.int64(source[read])
            run += more
            read += 1
        if read >= source.size:
            return written
        low: Any = np.int64(source[read])
        back = ((control & 31) << 8) + low + 1
        read += 1
        if back > written:
            return written
        run = min(run, target.size - written)
        for k in range(run):
            target[written + k] = target[written + k - back]
        written += run
    return written
