"""The map CR^2 of response vectors, its region grid, and how labels and regions go together.

Sec. Generalization to Other Real-World Datasets.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from sklearn.manifold import TSNE
from sklearn.preprocessing import StandardScaler

MAPS, CELLS, SHARE, PERPLEXITY = 3, 60, 0.05, 30  # maps, cells a side, neighbours that vote, t-SNE's own

DESCRIPTIONS = {
    "within": f"t-SNE map of the standardised vectors, grid of {CELLS} x {CELLS} regions, each labelled by most of "
    f"its nearest {SHARE:.0%} of the instances; mean share of a region's instances that bear its label; {MAPS} maps",
    "assigned": "on the same maps, mean share of a label's instances that lie in regions of that label",
}


@dataclass(frozen=True)
class Regions:
    """The region grid over a map.

    Attributes:
        low: (2,) lowest x and y; high: (2,) highest: the grid's outer borders.
        neighbours: k, how many of the nearest instances vote on a cell's label.
        cells: (60, 60) int64: the label of each row (y) and column (x).
        opacity: (60, 60): the share of the k nearest that bear it.
        of_points: (n,) int64: the label of the cell in which each instance lies.
    """

    low: NDArray[np.float32]
    high: NDArray[np.float32]
    neighbours: int
    cells: NDArray[np.int64]
    opacity: NDArray[np.float64]
    of_points: NDArray[np.int64]


@dataclass(frozen=True)
class RegionMatrices:
    """How labels and regions of the map go together, the mean over several maps.

    Attributes:
        labels: K of them, sorted.
        within: (K, K): of the instances in regions of one label (row), the share that bears each label (column).
        assigned: (K, K): of the instances of one label (row), the share that lies in regions of each label (column).
    """

    labels: tuple[str, ...]
    within: NDArray[np.float64]
    assigned: NDArray[np.float64]


def draw_response_map(vectors: NDArray[np.float64], seed: int) -> NDArray[np.float32]:
    """CR^2: standardised vectors (n, C) in the plane (n, 2); blind to labels."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)
        method = TSNE(2, perplexity=min(PERPLEXITY, len(vectors) // 4), random_state=seed, init="pca")
        return np.asarray(method.fit_transform(StandardScaler().fit_transform(vectors)))


def lay_regions(points: NDArray[np.float32], labels: NDArray[np.int64], count: int) -> Regions:
    """Lays the grid over a map: each cell has the label of most of the 5 % of instances nearest to its middle.

    Args:
        points: (n, 2) places of the instances.
        labels: (n,) of the instances, 0 to `count` - 1.
        count: number of labels; of equally frequent ones the first wins.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    k = max(2, round(SHARE * len(points)))
    middles = low + (np.arange(CELLS)[:, None] + 0.5) / CELLS * (high - low)  # (60, 2): of the columns, of the rows
    centres = np.stack(np.meshgrid(middles[:, 0], middles[:, 1]), axis=-1).reshape(-1, 2)
    neighbours = cKDTree(points).query(centres, k)[1]
    votes = np.stack([(labels[neighbours] == label).sum(axis=1) for label in range(count)], axis=1)
    cells = votes.argmax(axis=1).reshape(CELLS, CELLS)
    place = np.minimum(((points - low) / (high - low) * CELLS).astype(int), CELLS - 1)
    return Regions(
        low=low,
        high=high,
        neighbours=k,
        cells=cells,
        opacity=votes.max(axis=1).reshape(CELLS, CELLS) / k,
        of_points=cells[place[:, 1], place[:, 0]],
    )


def region_matrices(maps: Sequence[NDArray[np.float32]], labels: NDArray[np.str_]) -> RegionMatrices:
    """The two matrices of the region grids on several maps (n, 2) of instances with labels (n,)."""
    categories, places = np.unique(labels, return_inverse=True)
    regions = [lay_regions(points, places, len(categories)).of_points for points in maps]
    return RegionMatrices(
        tuple(map(str, categories)),
        np.mean([_shares(region, places, len(categories)) for region in regions], axis=0),
        np.mean([_shares(places, region, len(categories)) for region in regions], axis=0),
    )


def _shares(rows: NDArray[np.int64], columns: NDArray[np.int64], count: int) -> NDArray[np.float64]:
    """Of what is in a row, the share that is in each column (count, count); an empty row is 0."""
    table = np.zeros((count, count))
    np.add.at(table, (rows, columns), 1)
    return np.asarray(table / np.maximum(table.sum(axis=1, keepdims=True), 1))
