"""Labelled vectors -> figures: all that the protocols can tell of one way to describe clouds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from worker.evaluation import bootstrap, measures
from worker.evaluation.bootstrap import Estimate
from worker.evaluation.protocols import (
    Samples,
    nearest_neighbour,
    nearest_neighbour_of_others,
    support_vectors,
    support_vectors_of_others,
)
from worker.evaluation.regions import MAPS, RegionMatrices, draw_response_map, region_matrices
from worker.evaluation.report import Figures, Interval, Intervals


@dataclass(frozen=True)
class Recalled:
    """Labels, and what was predicted for the same clouds.

    Attributes:
        labels: (n,) true ones.
        groups: (n,) of the clouds.
        nearest: (n,) by the nearest neighbour.
        machines: (R, n) by support vector machines, R repetitions.
    """

    labels: NDArray[np.str_]
    groups: NDArray[np.str_]
    nearest: NDArray[np.str_]
    machines: NDArray[np.str_]

    def by_label(self) -> dict[str, dict[str, float]]:
        """Of each label, sorted, the recall by "knn" and by "svm"."""
        nearest = measures.recalls(self.labels, self.nearest)
        machines = [measures.recalls(self.labels, predicted) for predicted in self.machines]
        return {
            label: {"knn": knn, "svm": float(np.mean([each[label] for each in machines]))}
            for label, knn in nearest.items()
        }

    def intervals(self) -> Intervals:
        """The mean recalls."""
        return Intervals(
            knn=_interval(bootstrap.mean_recall(self.labels, self.groups, self.nearest)),
            svm=_interval(bootstrap.mean_recall(self.labels, self.groups, self.machines)),
        )

    def ahead_of(self, other: Recalled) -> Intervals:
        """The differences to another way to describe the same clouds."""
        return Intervals(
            knn=_interval(bootstrap.difference(self.labels, self.groups, self.nearest, other.nearest)),
            svm=_interval(bootstrap.difference(self.labels, self.groups, self.machines, other.machines)),
        )


@dataclass(frozen=True)
class Judgement:
    """What the protocols tell of vectors.

    Attributes:
        size: of a vector.
        recalled: labels and predictions.
        map: (n, 2) the first of the maps CR^2.
        regions: labels and regions, the mean over all maps.
    """

    size: int
    recalled: Recalled
    map: NDArray[np.float32]
    regions: RegionMatrices

    def by_label(self) -> dict[str, Figures]:
        """The four figures of each label, sorted."""
        diagonals = zip(np.diag(self.regions.within).tolist(), np.diag(self.regions.assigned).tolist(), strict=True)
        return {
            label: Figures(**recalls, within=within, assigned=assigned)
            for (label, recalls), (within, assigned) in zip(self.recalled.by_label().items(), diagonals, strict=True)
        }


def judge(samples: Samples) -> Judgement:
    """Follows all protocols; on one thread, as sums must not depend on the number of threads."""
    with threadpool_limits(1):
        maps = [draw_response_map(samples.vectors, seed) for seed in range(MAPS)]
        return Judgement(
            size=samples.vectors.shape[1],
            recalled=judge_recalls(samples),
            map=maps[0],
            regions=region_matrices(maps, samples.labels),
        )


def judge_recalls(samples: Samples) -> Recalled:
    """Follows the protocols that need no map; on one thread."""
    with threadpool_limits(1):
        return Recalled(samples.labels, samples.groups, nearest_neighbour(samples), support_vectors(samples))


def judge_others(samples: Samples, others: Samples) -> Recalled:
    """Judges another set's vectors by the samples; on one thread."""
    with threadpool_limits(1):
        return Recalled(
            others.labels,
            others.groups,
            nearest_neighbour_of_others(samples, others),
            support_vectors_of_others(samples, others),
        )


def mean_figures(by_label: Mapping[str, Figures]) -> Figures:
    """The means over labels."""
    means = {name: float(np.mean([getattr(f, name) for f in by_label.values()])) for name in Figures.model_fields}
    return Figures(**means)


def _interval(estimate: Estimate) -> Interval:
    return Interval(value=estimate.value, low=estimate.low, high=estimate.high)
