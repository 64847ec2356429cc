"""What can be told from vectors of clouds, by nearest neighbours and by a support vector machine.

Balanced over labels; clouds of one group never stand on both sides of a split. Sec. Unsupervised Concept Selection
(Table 1).
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist
from sklearn.model_selection import StratifiedGroupKFold
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC

from service.engine.errors import InvalidParameter

REPETITIONS, FOLDS, COST = 5, 5, 10.0  # of the support vector machine
OTHER_FOLDS = 10  # into which the groups of another set are split
BATCH = 256  # rows of distances in memory at a time

DESCRIPTIONS = {
    "knn": "nearest neighbour over standardised vectors, clouds of the same group left out; mean recall of labels",
    "svm": f"RBF support vector machine, C = {COST:g}, balanced, standardised vectors; {REPETITIONS} repetitions of "
    f"a stratified {FOLDS}-fold split by groups; mean recall of labels",
    "others": f"the same two, taught by the judged clouds and asked for the other set's in {OTHER_FOLDS} folds, clouds "
    "of the groups asked for left out; standardised by the judged clouds",
}


@dataclass(frozen=True)
class Samples:
    """Labelled vectors.

    Attributes:
        vectors: (n, C) float64.
        labels: (n,) str.
        groups: (n,) str: those of one group never stand on both sides of a split.
    """

    vectors: NDArray[np.float64]
    labels: NDArray[np.str_]
    groups: NDArray[np.str_]


def tells_apart(samples: Samples) -> bool:
    """Whether there are two numbers or more for each cloud, not the same for all clouds."""
    return samples.vectors.shape[1] >= 2 and bool(np.ptp(samples.vectors, axis=0).any())


def require(samples: Samples, what: str = "the model's responses") -> None:
    """Checks that the protocols can be followed.

    Args:
        samples: to be judged.
        what: their vectors are, for the message.

    Raises:
        InvalidParameter: they cannot.
    """
    if not tells_apart(samples):
        size = samples.vectors.shape[1]
        raise InvalidParameter(
            f"Nothing can be told from {what}: there {'is 1 number' if size == 1 else f'are {size} numbers'} for each "
            "cloud, and at least 2 are needed that are not the same for all clouds. A model that was trained on more "
            "objects has more concepts."
        )
    if len(set(samples.groups)) < FOLDS:
        raise InvalidParameter(
            f"The clouds form {len(set(samples.groups))} groups; to split them needs at least {FOLDS}."
        )


def nearest_neighbour(samples: Samples) -> NDArray[np.str_]:
    """The label of each vector's nearest neighbour in another group (n,)."""
    return _nearest(samples, samples, StandardScaler().fit(samples.vectors))


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
                vectors, labels = samples.vectors[taught], samples.labels[taught]
                scaler = StandardScaler().fit(vectors)
                predicted[repetition, asked] = _predict(vectors, labels, samples.vectors[asked], scaler)
    return predicted


def nearest_neighbour_of_others(samples: Samples, others: Samples) -> NDArray[np.str_]:
    """The label of the nearest of the samples to each of another set's vectors, of another group (m,)."""
    return _nearest(samples, others, StandardScaler().fit(samples.vectors))


def support_vectors_of_others(samples: Samples, others: Samples) -> NDArray[np.str_]:
    """The labels that a machine taught by the samples gives to another set's vectors (1, m).

    The other set's groups are split, so that a machine is taught without the groups that it is asked for.
    """
    scaler = StandardScaler().fit(samples.vectors)
    predicted = np.empty((1, len(others.labels)), samples.labels.dtype)
    for groups in np.array_split(np.unique(others.groups), OTHER_FOLDS):
        asked, taught = np.isin(others.groups, groups), ~np.isin(samples.groups, groups)
        if asked.any():
            vectors, labels = samples.vectors[taught], samples.labels[taught]
            predicted[0, asked] = _predict(vectors, labels, others.vectors[asked], scaler)
    return predicted


def _nearest(samples: Samples, asked: Samples, scaler: StandardScaler) -> NDArray[np.str_]:
    taught = scaler.transform(samples.vectors)
    nearest = np.empty(len(asked.vectors), np.int64)
    for first in range(0, len(nearest), BATCH):
        rows = slice(first, first + BATCH)
        distances = cdist(scaler.transform(asked.vectors[rows]), taught)
        distances[asked.groups[rows, None] == samples.groups] = np.inf
        nearest[rows] = distances.argmin(axis=1)
    return samples.labels[nearest]


def _predict(
    vectors: NDArray[np.float64], labels: NDArray[np.str_], asked: NDArray[np.float64], scaler: StandardScaler
) -> NDArray[np.str_]:
    if (labels == labels[0]).all():  # there is nothing to tell apart
        return np.full(len(asked), labels[0])
    machine = SVC(C=COST, class_weight="balanced").fit(scaler.transform(vectors), labels)
    return np.asarray(machine.predict(scaler.transform(asked)))
