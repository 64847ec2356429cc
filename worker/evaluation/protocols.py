"""What can be told from response vectors: by nearest neighbours, by a support vector machine, and on a map.

Balanced over labels; clouds of one group never stand on both sides of a split. Sec. Unsupervised Concept Selection
(Table 1) and Sec. Generalization to Other Real-World Datasets (CR^2, its region grid, and the two matrices).
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist
from sklearn.manifold import TSNE
from sklearn.model_selection import StratifiedGroupKFold
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC

from service.engine.errors import InvalidParameter

REPETITIONS, FOLDS, COST = 5, 5, 10.0  # of the support vector machine
MAPS, CELLS, SHARE, PERPLEXITY = 3, 60, 0.05, 30  # of the region grid: maps, cells a side, neighbours, t-SNE's own
BATCH = 256  # rows of distances in memory at a time

DESCRIPTIONS = {
    "knn": "nearest neighbour over standardised responses, clouds of the same group left out; mean recall of labels",
    "svm": f"RBF support vector machine, C = {COST:g}, balanced, standardised responses; {REPETITIONS} repetitions of "
    f"a stratified {FOLDS}-fold split by groups; mean recall of labels",
    "within": f"t-SNE map of the standardised responses, grid of {CELLS} x {CELLS} regions, each labelled by most of "
    f"its nearest {SHARE:.0%} of the instances; mean share of a region's instances that bear its label; {MAPS} maps",
    "assigned": "on the same maps, mean share of a label's instances that lie in regions of that label",
}


@dataclass(frozen=True)
class Samples:
    """Labelled response vectors.

    Attributes:
        vectors: (n, C) float64.
        labels: (n,) str.
        groups: (n,) str: those of one group never stand on both sides of a split.
    """

    vectors: NDArray[np.float64]
    labels: NDArray[np.str_]
    groups: NDArray[np.str_]


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


def require(samples: Samples) -> None:
    """Checks that the protocols can be followed.

    Raises:
        InvalidParameter: they cannot.
    """
    if samples.vectors.shape[1] < 2 or not np.ptp(samples.vectors, axis=0).any():
        raise InvalidParameter(
            f"The model has {samples.vectors.shape[1]} concepts, whose responses are the same for all clouds or too "
            "few to tell them apart: train on more objects."
        )
    if len(set(samples.groups)) < FOLDS:
        raise InvalidParameter(
            f"The clouds form {len(set(samples.groups))} groups; to split them needs at least {FOLDS}."
        )


def nearest_neighbour(samples: Samples) -> NDArray[np.str_]:
    """The label of each vector's nearest neighbour in another group (n,)."""
    vectors = StandardScaler().fit_transform(samples.vectors)
    nearest = np.empty(len(vectors), np.int64)
    for first in range(0, len(vectors), BATCH):
        rows = slice(first, first + BATCH)
        distances = cdist(vectors[rows], vectors)
        distances[samples.groups[rows, None] == samples.groups] = np.inf
        nearest[rows] = distances.argmin(axis=1)
    return samples.labels[nearest]


def support_vectors(samples: Samples) -> NDArray[np.str_]:
    """The labels that a support vector machine gives to vectors of groups it has not seen (repetitions, n)."""
    predicted = np.empty((REPETITIONS, len(samples.labels)), samples.labels.dtype)
    for repetition in range(REPETITIONS):
        split = StratifiedGroupKFold(FOLDS, shuffle=True, random_state=repetition)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # a label with fewer groups than folds is ordinary here
            folds = list(split.split(samples.vectors, samples.labels, samples.groups))
        for taught, asked in folds:
            if len(asked):
                predicted[repetition, asked] = _predict(samples, taught, asked)
    return predicted


def _predict(samples: Samples, taught: NDArray[np.int64], asked: NDArray[np.int64]) -> NDArray[np.str_]:
    labels = samples.labels[taught]
    if (labels == labels[0]).all():  # there is nothing to tell apart
        return np.full(len(asked), labels[0])
    machine = make_pipeline(StandardScaler(), SVC(C=COST, class_weight="balanced"))
    return np.asarray(machine.fit(samples.vectors[taught], labels).predict(samples.vectors[asked]))


def region_matrices(samples: Samples) -> RegionMatrices:
    """The two matrices of the region grid on the t-SNE map CR^2."""
    categories, labels = np.unique(samples.labels, return_inverse=True)
    vectors = StandardScaler().fit_transform(samples.vectors)
    maps = [_map(vectors, seed) for seed in range(MAPS)]
    regions = [_regions(points, labels, len(categories)) for points in maps]
    return RegionMatrices(
        tuple(map(str, categories)),
        np.mean([_shares(region, labels, len(categories)) for region in regions], axis=0),
        np.mean([_shares(labels, region, len(categories)) for region in regions], axis=0),
    )


def _map(vectors: NDArray[np.float64], seed: int) -> NDArray[np.float64]:
    """CR^2: the vectors in the plane (n, 2); blind to labels."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)
        method = TSNE(2, perplexity=min(PERPLEXITY, len(vectors) // 4), random_state=seed, init="pca")
        return np.asarray(method.fit_transform(vectors))


def _regions(points: NDArray[np.float64], labels: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """The label of the region in which each point lies (n,): that of most of the nearest 5 % of points."""
    low, high = points.min(axis=0), points.max(axis=0)
    cell = np.minimum(((points - low) / (high - low) * CELLS).astype(int), CELLS - 1)
    centre = low + (cell + 0.5) / CELLS * (high - low)
    neighbours = cKDTree(points).query(centre, max(2, round(SHARE * len(points))))[1]
    votes = (labels[neighbours][:, :, None] == np.arange(count)).sum(axis=1)  # (n, K)
    return np.asarray(votes.argmax(axis=1))


def _shares(rows: NDArray[np.int64], columns: NDArray[np.int64], count: int) -> NDArray[np.float64]:
    """Of what is in a row, the share that is in each column (count, count); an empty row is 0."""
    table = np.zeros((count, count))
    np.add.at(table, (rows, columns), 1)
    return np.asarray(table / np.maximum(table.sum(axis=1, keepdims=True), 1))
