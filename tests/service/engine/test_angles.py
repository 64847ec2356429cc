"""Angles without calls, against numpy's."""

from __future__ import annotations

import numpy as np
from numba import njit

from service.engine.angles import ERROR, turn


@njit
def turns(y, x):
    out = np.empty_like(y)
    for i in range(len(y)):
        out[i] = turn(y[i], x[i])
    return out


def test_angles_are_arctangents_all_around():
    way = np.linspace(-np.pi, np.pi, 100_001)[1:]
    length = np.random.default_rng(0).uniform(1e-6, 1e6, len(way))
    y, x = length * np.sin(way), length * np.cos(way)
    assert np.abs(turns(y, x) - np.arctan2(y, x)).max() < ERROR


def test_angles_along_the_axes():
    y, x = np.array([0.0, 0.0, 1.0, -1.0, 0.0]), np.array([1.0, -1.0, 0.0, 0.0, 0.0])
    assert np.allclose(turns(y, x), np.arctan2(y, x), atol=ERROR)
