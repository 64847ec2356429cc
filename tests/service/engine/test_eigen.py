"""Principal axes of single matrices against LAPACK."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from service.engine.eigen import principal_axes

SPREADS = {
    "a plane": [1, 0.5, 1e-6],
    "a line": [1, 1e-3, 1e-8],
    "a disc": [1, 0.999999, 0.1],
    "a rod": [1, 1e-2, 0.99e-2],
    "a ball": [1, 1, 1],
    "a point": [0, 0, 0],
    "a point but for rounding": [-1e-17, -1e-17, -1e-17],
}


def matrices(spread: list[float]) -> list[NDArray[np.float64]]:
    rng = np.random.default_rng(0)
    turns = [np.eye(3), *(np.linalg.qr(rng.standard_normal((3, 3)))[0] for _ in range(200))]
    return [turn @ np.diag(spread) @ turn.T for turn in turns]


@pytest.mark.parametrize("spread", SPREADS)
def test_axes_are_those_of_lapack(spread: str):
    for matrix in matrices(SPREADS[spread]):
        variance, first, last = principal_axes(tuple(matrix[np.triu_indices(3)]))
        assert np.allclose(variance, np.linalg.eigvalsh(matrix), atol=1e-14)
        for axis, value in ((np.array(first), variance[0]), (np.array(last), variance[2])):
            assert np.linalg.norm(axis) == pytest.approx(1, abs=1e-12)
            assert np.allclose(matrix @ axis, value * axis, atol=1e-14)
