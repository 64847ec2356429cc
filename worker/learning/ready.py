"""Importing this loads whatever describes a cloud, compiled code included, so that forked processes need not."""

from __future__ import annotations

import numpy as np

from service.engine.cloud import PointCloud
from service.engine.params import ModelParams
from worker.learning.observations import NamedCloud, observe_one

SIDE, DISTANCE = 0.2, 1.0  # metres


def _corner() -> PointCloud:
    """Two faces of a box, seen by their common edge."""
    along, across = (c.ravel() for c in np.meshgrid(np.linspace(0, SIDE, 40), np.linspace(0, SIDE, 40)))
    left, right = (np.stack([side * along, across, DISTANCE + along], axis=1) for side in (-1, 1))
    return PointCloud(np.concatenate([left, right]).astype(np.float32))


observe_one(NamedCloud("corner", _corner()), ModelParams())
