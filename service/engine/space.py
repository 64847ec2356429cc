"""The topological space X, as the worker builds it and a model holds it (Sec. Topological Space Generation)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class TopologicalSpace:
    """The minimum spanning tree over N stimuli vectors, and how central its vertices are.

    Attributes:
        edges: (N - 1, 2) int64: the smaller vertex first, in lexicographic order.
        distance: (N - 1,) float64: JSD of the two stimuli vectors, nats.
        geodesic_sum: (N,) int64: sum of the geodesic distances to all vertices, each edge of length 1.
    """

    edges: NDArray[np.int64]
    distance: NDArray[np.float64]
    geodesic_sum: NDArray[np.int64]

    @property
    def vertex_heat(self) -> NDArray[np.float64]:
        """h(x) (N,): the mean geodesic distance, Eq. 3."""
        return self.geodesic_sum / len(self.geodesic_sum)
