"""Linear algebra on one thread: sums must not depend on how many there are, and processes share the cores already."""

from __future__ import annotations

from contextlib import AbstractContextManager
from functools import cache
from typing import Any

from threadpoolctl import ThreadpoolController


def one_thread() -> AbstractContextManager[Any]:
    """Numpy's and scipy's linear algebra runs on one thread within."""
    limited: AbstractContextManager[Any] = _controller().limit(limits=1)
    return limited


@cache
def _controller() -> ThreadpoolController:
    """Made but once: to look for the libraries in a process takes as long as to describe a cloud."""
    import scipy.linalg  # noqa: F401  has its library loaded, so that it is found

    return ThreadpoolController()
