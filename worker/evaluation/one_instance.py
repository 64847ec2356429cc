"""What one instance a label is enough for.

Sec. Shape Knowledge Transfer from Mental Simulation to Real-World Data: the motif prototypes of a single instance of
each label are labelled, and the label with the highest accumulated stimulus wins.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray
from scipy.spatial.distance import cdist
from sklearn.preprocessing import StandardScaler
from threadpoolctl import threadpool_limits

from service.engine.dictionary import Dictionary
from service.engine.params import ModelParams
from service.engine.stimuli import stimulate
from worker.evaluation.answering import Count
from worker.evaluation.report import Spread, Transfer
from worker.learning.hierarchy import grow_ensemble
from worker.learning.observations import Observation

DRAWS = 500
SEED = 0
# Eq. 1 to the letter, whatever the model's own stimuli are: where any constellation may excite any vertex, instances of
# many segments collect most, whatever is asked for (on real scans 0.47 of the labels are found, by the letter 0.67).
STIMULI = ModelParams.preset("paper").stimuli

DESCRIPTION = (
    f"of each label one instance is drawn, {DRAWS} times; it alone grows a motif hierarchy ensemble over the model's "
    "dictionary, whose prototypes bear its label; every cloud of a group that was not drawn from has the label whose "
    "vertices are excited most in sum, by Eq. 1 to the letter; recalls of labels, their mean, and the spread over draws"
)


def transfer(
    objects: Sequence[Observation],
    labels: NDArray[np.str_],
    groups: NDArray[np.str_],
    dictionary: Dictionary,
    vectors: Mapping[str, NDArray[np.float64]],
    count: Count = lambda items, total: items,
) -> Transfer | None:
    """Teaches one instance a label, again and again, and asks for the clouds of all other groups.

    Args:
        objects: n of them, as the model sees them.
        labels: (n,) of them.
        groups: (n,): clouds of the groups of the instances are not asked for.
        dictionary: of the model; it has seen none of the objects' labels.
        vectors: (n, D) each: what is tried beside, the label of the nearest instance winning.
        count: hands on what it is given, and may show how far that is.

    Returns:
        None where every draw takes an instance of all groups, so that nothing is left to ask for.
    """
    drawn = draw_instances(labels)
    taught = np.unique(drawn)
    words = [dictionary.words(o.segment_descriptors) for o in objects]
    results = Parallel(return_as="generator")(
        delayed(_accumulated)(objects[t], objects, words, dictionary) for t in taught
    )
    stimuli = np.full((len(objects), len(objects)), -np.inf)
    for t, column in zip(taught, count(results, len(taught)), strict=True):
        stimuli[:, t] = column
    recalls = _recalls(stimuli, drawn, labels, groups)
    if not np.isfinite(recalls).any():
        return None
    beside = {name: _recalls(-_distances(each), drawn, labels, groups) for name, each in vectors.items()}
    by_label = zip(np.unique(labels).tolist(), recalls.T, strict=True)
    return Transfer(
        draws=DRAWS,
        recall=_spread(_mean_recalls(recalls)),
        by_label={label: _spread(each) for label, each in by_label if np.isfinite(each).any()},
        rivals={name: _spread(_mean_recalls(each)) for name, each in beside.items()},
    )


def draw_instances(labels: NDArray[np.str_]) -> NDArray[np.int64]:
    """The instances taught in each draw (draws, K): the place of one of each label, uniformly drawn, labels sorted."""
    rng = np.random.default_rng(SEED)
    return np.stack([rng.choice(np.flatnonzero(labels == label), DRAWS) for label in np.unique(labels)], axis=1)


def _accumulated(
    taught: Observation,
    asked: Sequence[Observation],
    words: Sequence[NDArray[np.int64]],
    dictionary: Dictionary,
) -> NDArray[np.float64]:
    """The stimuli of each object, in sum over the vertices of the ensemble of one instance (n,); none is -infinity.

    Prototypes that bear different labels never share a vertex, so that each label's sum is the same whatever else is
    taught beside it.
    """
    with threadpool_limits(1):
        ensemble = grow_ensemble([taught], dictionary)
        stimuli = (
            stimulate(ensemble, o.constellations, o.descriptors, w, STIMULI) for o, w in zip(asked, words, strict=True)
        )
        sums = np.array([gamma.values.sum(dtype=np.float64) for gamma in stimuli])
        return np.where(sums > 0, sums, -np.inf)


def _distances(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    scaled = StandardScaler().fit_transform(vectors)
    return np.asarray(cdist(scaled, scaled))


def _recalls(
    closeness: NDArray[np.float64], drawn: NDArray[np.int64], labels: NDArray[np.str_], groups: NDArray[np.str_]
) -> NDArray[np.float64]:
    """The recall of each label in each draw (draws, K), NaN where none of its clouds is asked for.

    Args:
        closeness: (n, n) of each object to each instance; the closest wins, of equal ones the first label; where all
            are -infinity there is no answer.
        drawn: (draws, K) places of the instances.
        labels: (n,) of the objects.
        groups: (n,) of the objects.
    """
    categories, true = np.unique(labels, return_inverse=True)
    recalls = np.full(drawn.shape, np.nan)
    for draw, instances in enumerate(drawn):
        asked = ~np.isin(groups, groups[instances])
        of_labels = closeness[np.ix_(asked, instances)]
        right = (of_labels.argmax(axis=1) == true[asked]) & np.isfinite(of_labels.max(axis=1))
        count = np.bincount(true[asked], minlength=len(categories))
        hits = np.bincount(true[asked], right, minlength=len(categories))
        recalls[draw, count > 0] = hits[count > 0] / count[count > 0]
    return recalls


def _mean_recalls(recalls: NDArray[np.float64]) -> NDArray[np.float64]:
    asked = np.isfinite(recalls)
    return np.where(asked, recalls, 0).sum(axis=1)[asked.any(axis=1)] / asked.sum(axis=1)[asked.any(axis=1)]


def _spread(values: NDArray[np.float64]) -> Spread:
    known = values[np.isfinite(values)]
    low, high = np.quantile(known, [0.025, 0.975])
    return Spread(mean=float(known.mean()), deviation=float(known.std()), low=float(low), high=float(high))
