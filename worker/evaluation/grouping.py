"""How concepts and labels go together, and whether a plain clustering of whole clouds would have done better.

Sec. Unsupervised Concept Selection, Eq. 5 and 6. The prototypes of a model are known by the hashes of their clouds, so
this can be told only where the model was trained on clouds that are labelled.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sklearn.cluster import HDBSCAN, KMeans
from sklearn.metrics import adjusted_rand_score, v_measure_score
from sklearn.preprocessing import StandardScaler

from service.engine.concepts import Concepts
from service.engine.model import ShapeModel
from worker.evaluation import measures
from worker.evaluation.report import ConceptPurity, GroupFigures, Grouping, RivalGrouping

RUNS = 10  # of k-means, each with a seed of its own
RESTARTS = 10  # of one run of k-means, of which the tightest counts
SIZES = 40  # minimum cluster sizes of HDBSCAN that are tried

DESCRIPTIONS = {
    "grouping": "prototypes of 'other' agree with no label, not even with each other's; in V-measure and adjusted Rand "
    "index over all labelled prototypes, each that is in no group is a group of its own",
    "rivals": f"k-means over standardised vectors, means of {RUNS} seeds, with as many groups as there are concepts; "
    "HDBSCAN over the same, with the minimum cluster size that comes nearest to that number",
}


@dataclass(frozen=True)
class LabelledPrototypes:
    """The prototypes of a model whose labels are known.

    Attributes:
        digests: (n,) hashes of their clouds, in hexadecimal.
        labels: (n,) of them.
        assignment: (n,) int64: the place of each one's concept, -1 for none.
        categories: that a group can be pure of, sorted.
        concepts: of the model.
    """

    digests: tuple[str, ...]
    labels: tuple[str, ...]
    assignment: NDArray[np.int64]
    categories: tuple[str, ...]
    concepts: Concepts

    @property
    def covered(self) -> NDArray[np.bool_]:
        """Which of them belong to a concept (n,)."""
        return self.assignment >= 0


def labelled_prototypes(
    model: ShapeModel, labels_of: Mapping[str, str], categories: Sequence[str]
) -> LabelledPrototypes | None:
    """The labelled prototypes of a model, or None where no concept has one.

    Args:
        model: whose prototypes are known by the hashes of their clouds.
        labels_of: the label of each hash.
        categories: that a group can be pure of; a prototype with another label makes its group impure.
    """
    concepts, hashes = model.concepts(), model.prototypes.cloud_hashes
    places = [place for place, digest in enumerate(hashes) if digest in labels_of]
    if not (concepts.assignment[places] >= 0).any():
        return None
    return LabelledPrototypes(
        digests=tuple(hashes[place] for place in places),
        labels=tuple(labels_of[hashes[place]] for place in places),
        assignment=concepts.assignment[places],
        categories=tuple(sorted(categories)),
        concepts=concepts,
    )


def judge_grouping(known: LabelledPrototypes, vectors: Mapping[str, NDArray[np.float64]]) -> Grouping:
    """Judges the concepts, and the clusterings of whole-cloud vectors beside them.

    Args:
        known: the labelled prototypes.
        vectors: (n, D) of each baseline, of the same prototypes.
    """
    figures = group_figures(known.assignment, known)
    ranked = _ranked(known)
    rivals = [rival for name, each in vectors.items() for rival in _rivals(name, each, figures.groups, known)]
    return Grouping(
        prototypes=len(known.labels),
        covered=figures.covered,
        purity=figures.purity,
        pure=figures.pure,
        concepts=sorted(ranked, key=lambda concept: -concept.rank_score),
        figures=figures,
        rivals=rivals,
    )


def group_figures(assignment: NDArray[np.int64], known: LabelledPrototypes) -> GroupFigures:
    """How groups of labelled prototypes go together with their labels.

    Args:
        assignment: (n,) the group of each, -1 for none; at least one is in a group.
        known: labels, and which prototypes the concepts cover.
    """
    sizes, counts = _counts(assignment, known)
    purities = measures.purity(counts, sizes)
    truth, groups = _classes(known), _groups(assignment)
    inside = known.covered
    return GroupFigures(
        groups=len(sizes),
        covered=float(np.mean(assignment >= 0)),
        purity=float(purities.mean()),
        pure=measures.pure_share(purities),
        v_measure=float(v_measure_score(truth, groups)),
        adjusted_rand=float(adjusted_rand_score(truth, groups)),
        v_measure_covered=float(v_measure_score(truth[inside], groups[inside])),
        adjusted_rand_covered=float(adjusted_rand_score(truth[inside], groups[inside])),
    )


def _rivals(name: str, vectors: NDArray[np.float64], groups: int, known: LabelledPrototypes) -> list[RivalGrouping]:
    """What k-means and HDBSCAN make of a baseline's vectors; none where there are too few to cluster."""
    scaled = StandardScaler().fit_transform(vectors)
    if len(np.unique(scaled, axis=0)) < max(groups, 2):
        return []
    runs = [KMeans(groups, n_init=RESTARTS, random_state=seed).fit_predict(scaled) for seed in range(RUNS)]
    means = _mean([group_figures(run.astype(np.int64), known) for run in runs])
    rivals = [RivalGrouping(vectors=name, method="k-means", setting=f"k = {groups}", runs=RUNS, figures=means)]
    size, dense = _dense_clusters(scaled, groups)
    if (dense >= 0).any():
        setting = f"minimum cluster size {size}"
        figures = group_figures(dense, known)
        rivals.append(RivalGrouping(vectors=name, method="HDBSCAN", setting=setting, runs=1, figures=figures))
    return rivals


def _dense_clusters(vectors: NDArray[np.float64], groups: int) -> tuple[int, NDArray[np.int64]]:
    """The minimum cluster size of HDBSCAN that comes nearest to a number of groups, the smallest; its clusters."""
    found = []
    for size in np.unique(np.geomspace(2, max(2, len(vectors) // 2), SIZES).astype(int)):
        labels = HDBSCAN(min_cluster_size=int(size), copy=True).fit_predict(vectors).astype(np.int64)
        found.append((abs(labels.max() + 1 - groups), int(size), labels))
    _, size, labels = min(found, key=lambda each: each[:2])
    return size, labels


def _ranked(known: LabelledPrototypes) -> list[ConceptPurity]:
    """Each concept with a labelled prototype: its labels, purity and rank score."""
    sizes, counts = _counts(known.assignment, known)
    present = np.unique(known.assignment[known.covered])
    purities = measures.purity(counts, sizes)
    scores = measures.rank_score(purities, sizes)
    return [
        ConceptPurity(
            id=int(known.concepts.ids[concept]),
            prototypes=int(sizes[row]),
            label=known.categories[counts[row].argmax()] if counts[row].any() else None,
            labels=dict(
                sorted(
                    Counter(x for x, of in zip(known.labels, known.assignment, strict=True) if of == concept).items()
                )
            ),
            purity=float(purities[row]),
            rank_score=float(scores[row]),
        )
        for row, concept in enumerate(present)
    ]


def _counts(assignment: NDArray[np.int64], known: LabelledPrototypes) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Of each group that has members: how many there are (G,), and how many of each category (G, K)."""
    sizes = np.bincount(assignment[assignment >= 0])
    counts = measures.label_counts(assignment, known.labels, known.categories)
    return sizes[sizes > 0], counts[sizes > 0]


def _classes(known: LabelledPrototypes) -> NDArray[np.int64]:
    """The label of each prototype as a number (n,); what is no category has a number of its own."""
    place = {category: number for number, category in enumerate(known.categories)}
    return np.array([place.get(label, len(place) + row) for row, label in enumerate(known.labels)])


def _groups(assignment: NDArray[np.int64]) -> NDArray[np.int64]:
    """The group of each (n,), where what is in none is a group of its own."""
    own = assignment.max(initial=-1) + 1 + np.arange(len(assignment))
    return np.where(assignment >= 0, assignment, own)


def _mean(figures: Sequence[GroupFigures]) -> GroupFigures:
    means = {name: float(np.mean([getattr(each, name) for each in figures])) for name in GroupFigures.model_fields}
    return GroupFigures(**(means | {"groups": round(means["groups"])}))
