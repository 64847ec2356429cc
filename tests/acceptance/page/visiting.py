"""How tests visit the page, and ask the service without it."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any

import httpx
import numpy as np

from tests.acceptance.browsing import Visit

CLOUD = ".cloud-canvas"
Visiting = Callable[..., Visit]


def asked(host: str, content: bytes, **query: object) -> dict[str, Any]:
    """What the service answers without a browser."""
    answer: dict[str, Any] = httpx.post(f"{host}/v1/responses", params=query, content=content, timeout=60).json()
    return answer


def fingertips(count: int) -> bytes:
    """A dense bowl-like cloud as NPY."""
    rng = np.random.default_rng(0)
    across = rng.uniform(-0.1, 0.1, (count, 2))
    points = np.column_stack([across, 0.6 + 4 * (across**2).sum(axis=1)]).astype(np.float32)
    file = io.BytesIO()
    np.save(file, points)
    return file.getvalue()
