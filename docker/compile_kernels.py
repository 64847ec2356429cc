"""Has every kernel compiled once, so that no container does it at its start: half a minute on one core.

Answers the built-in model's example in every form whose reading has a kernel of its own, and in every detail; where
the worker is installed, it also learns a tiny model and judges it, unless told --answering. Numba keeps the machine
code in NUMBA_CACHE_DIR.
"""

from __future__ import annotations

import importlib.util
import json
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from service.application import Application, CloudFile
from service.clouds.json_list import split
from service.settings import Settings
from service.transports.rest.examples import CLOUD_JSON, CLOUD_XYZ


def clouds(points: np.ndarray) -> list[bytes]:
    """The points, (N, 3) metres, as files of every format that is read by a kernel."""
    count = len(points)
    plain = points.T.astype("<f4").tobytes()
    packed = b"".join(bytes([len(plain[i : i + 32]) - 1]) + plain[i : i + 32] for i in range(0, len(plain), 32))
    pcd = (
        "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
        f"WIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA binary_compressed\n"
    )
    ply = (  # an element of lists before the vertices must be walked through
        "ply\nformat binary_little_endian 1.0\nelement face 1\nproperty list uchar int vertex_indices\n"
        f"element vertex {count}\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    )
    return [
        CLOUD_XYZ.encode(),
        json.dumps(CLOUD_JSON).encode(),
        json.dumps(CLOUD_JSON["points"]).encode(),
        pcd.encode() + struct.pack("<II", len(packed), len(plain)) + packed,
        ply.encode() + struct.pack("<B3i", 3, 0, 1, 2) + points.astype("<f4").tobytes(),
    ]


def table(points: np.ndarray) -> bytes:
    """The points standing on a table of 1 m, 2 mm apart, as text."""
    across = np.linspace(-0.5, 0.5, 200)
    x, z = (axis.ravel() for axis in np.meshgrid(across, across + 0.8))
    top = np.stack([x, np.full_like(x, points[:, 1].max()), z], axis=1)
    return "\n".join(" ".join(f"{value:.4f}" for value in row) for row in np.concatenate([top, points])).encode()


def answer(folder: Path) -> None:
    """Compiles what answering needs."""
    points = np.array([line.split() for line in CLOUD_XYZ.splitlines()], float)
    application = Application(Settings(store=str(folder / "none"), jobs_url=f"sqlite:///{folder / 'none.sqlite'}"))
    for data in clouds(points):
        application.respond(CloudFile(data), explain=True, segments=True, stimuli=True)
        application.respond(CloudFile(data), time=0.5)
    application.respond_scene(CloudFile(table(points)), explain=True, segments=True)
    split(json.dumps([CLOUD_JSON, CLOUD_JSON]).encode(), 64)
    application.close()


def learn(folder: Path) -> None:
    """Compiles what learning and judging need."""
    simulated, store = folder / "clouds", str(folder / "store")
    labels, report = str(simulated / "labels.csv"), str(folder / "report")
    commands = [
        ["simulate", "--count", "12", "--renderer", "raycast", "--out", str(simulated)],
        ["train", "--clouds", str(simulated), "--name", "tiny", "--store", store],
        ["evaluate", "--model", "tiny", "--labels", labels, "--report", report, "--store", store],
    ]
    for arguments in commands:
        subprocess.run(["shape-concepts-worker", *arguments, "--workers", "1"], check=True)
        if arguments[0] == "simulate":
            files = sorted(path.name for path in simulated.glob("*.ply"))
            rows = [f"{name},{'ab'[i % 2]}" for i, name in enumerate(files)]
            Path(labels).write_text("\n".join(["file,category", *rows]) + "\n")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as temporary:
        answer(Path(temporary))
        if importlib.util.find_spec("worker") and "--answering" not in sys.argv[1:]:
            learn(Path(temporary))
