"""Processes that are ready when there is work for them: they import while the process that asks for them still does."""

from __future__ import annotations

import multiprocessing
from multiprocessing import forkserver

PRELOADED = ("worker.sources", "worker.learning.ready")
RENDERERS = {"raycast": "worker.simulation.raycast", "sapien": "worker.simulation.scene"}


def prepare(renderer: str | None = None) -> None:
    """Has all processes that joblib starts from now on stem from one that has imported, once, what learning needs.

    For programs whose only purpose is to simulate and to learn: these processes are in a session of their own, and
    cannot be handed large arrays in shared memory.

    Args:
        renderer: "sapien" or "raycast"; None where it is not known yet.
    """
    # What a plain process takes two seconds to import, and compiled code to load, a forked one has from the start.
    from joblib.externals.loky.backend.context import set_start_method

    multiprocessing.set_forkserver_preload([*PRELOADED, *([RENDERERS[renderer]] if renderer else [])])
    forkserver.ensure_running()
    set_start_method("forkserver", force=True)
