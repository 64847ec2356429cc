"""Processes that are ready when there is work for them, and end when nobody can give them any."""

from __future__ import annotations

import multiprocessing
import os
import threading
from multiprocessing import forkserver
from multiprocessing.connection import wait

PRELOADED = ("worker.sources", "worker.learning.ready")
RENDERERS = {"raycast": "worker.simulation.raycast", "sapien": "worker.simulation.scene"}


def prepare(renderer: str | None = None) -> None:
    """Has all processes that joblib starts from now on stem from one that has imported, once, what learning needs.

    It imports while the program that asks for it still does.

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


def end_with(pid: int) -> None:
    """Has this process end when another one does, however that ends: joblib's would wait minutes for more work.

    Only Linux can tell of any process that it has ended; elsewhere nothing is done.
    """
    if hasattr(os, "pidfd_open"):
        threading.Thread(target=_end_after, args=[os.pidfd_open(pid)], daemon=True).start()


def _end_after(process: int) -> None:
    wait([process])
    os._exit(1)
