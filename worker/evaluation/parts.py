"""Judgements -> the parts of a report."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from service.engine.model import ShapeModel
from worker.evaluation import measures
from worker.evaluation.answering import Answered, AnsweredSet
from worker.evaluation.judgement import Judgement, Recalled, mean_figures
from worker.evaluation.regions import lay_regions
from worker.evaluation.report import (
    Baseline,
    Data,
    OtherFigures,
    OtherSet,
    Place,
    RegionGrid,
    ResponseMap,
    SourceFigures,
    Structure,
)

DIGITS = 4  # of the map's coordinates and of opacities: finer than any drawing


def data_of(answered: AnsweredSet, kept: Sequence[Answered]) -> Data:
    """The clouds of a labels' file, and which of them are judged."""
    categories = Counter(each.cloud.category for each in kept)
    every = Counter(each.cloud.category for each in answered.answered)
    return Data(
        labels=str(answered.table),
        sha256=hashlib.sha256(answered.table.read_bytes()).hexdigest(),
        clouds=len(answered.answered) + len(answered.refused),
        judged=len(kept),
        groups=len({each.cloud.group for each in kept}),
        categories=dict(sorted(categories.items())),
        not_judged=dict(sorted((every - categories).items())),
        unanswered={each.cloud.file: str(each.error) for each in answered.refused},
    )


def by_source(recalled: Recalled, kept: Sequence[Answered]) -> dict[str, SourceFigures]:
    """The figures of each source's clouds, with those of all sources to learn from."""
    sources = np.array([each.cloud.source for each in kept])
    of_source = {}
    for source in filter(None, np.unique(sources).tolist()):
        here = sources == source
        recalls = [measures.balanced_accuracy(recalled.labels[here], each[here]) for each in recalled.machines]
        of_source[source] = SourceFigures(
            clouds=int(here.sum()),
            knn=measures.balanced_accuracy(recalled.labels[here], recalled.nearest[here]),
            svm=float(np.mean(recalls)),
        )
    return of_source


def map_of(own: Judgement, kept: Sequence[Answered]) -> ResponseMap:
    """The first of the maps, and its regions."""
    labels, places = np.unique(own.recalled.labels, return_inverse=True)
    regions = lay_regions(own.map, places, len(labels))
    low, high = (np.round(corner.astype(np.float64), DIGITS).tolist() for corner in (regions.low, regions.high))
    points = np.round(own.map.astype(np.float64), DIGITS).tolist()
    return ResponseMap(
        seed=0,
        places=[
            Place(
                file=each.cloud.file, label=each.cloud.category, source=each.cloud.source, concept=each.best, x=x, y=y
            )
            for each, (x, y) in zip(kept, points, strict=True)
        ],
        regions=RegionGrid(
            low=(low[0], low[1]),
            high=(high[0], high[1]),
            neighbours=regions.neighbours,
            labels=labels.tolist(),
            cells=regions.cells.tolist(),
            opacity=np.round(regions.opacity, DIGITS).tolist(),
        ),
    )


def baseline_of(description: str, judgement: Judgement, own: Judgement) -> Baseline:
    """Other vectors of the clouds, and how far the model's own are ahead of them."""
    by_label = judgement.by_label()
    return Baseline(
        description=description,
        dimensions=judgement.size,
        figures=mean_figures(by_label),
        by_label=by_label,
        intervals=judgement.recalled.intervals(),
        ahead=own.recalled.ahead_of(judgement.recalled),
    )


def other_set(data: Data, own: Recalled, rivals: Mapping[str, Recalled]) -> OtherSet:
    """Another set's clouds: what the model predicts for them, and what the baselines do."""
    return OtherSet(
        data=data,
        model=_other_figures(own),
        baselines={name: _other_figures(each, own) for name, each in rivals.items()},
    )


def _other_figures(recalled: Recalled, own: Recalled | None = None) -> OtherFigures:
    return OtherFigures(
        intervals=recalled.intervals(),
        by_label=recalled.by_label(),
        ahead=own.ahead_of(recalled) if own else None,
    )


def structure_of(model: ShapeModel, labels_of: Mapping[str, str]) -> Structure:
    """What trees, graphs, barcodes and annexations are drawn of; `labels_of` by the hashes of labelled clouds."""
    space, filtration, concepts = model.space, model.filtration, model.concepts()
    return Structure(
        keys=list(model.prototypes.cloud_keys),
        labels=[labels_of.get(digest) for digest in model.prototypes.cloud_hashes],
        heat=space.vertex_heat.tolist(),
        edges=[(int(a), int(b)) for a, b in space.edges],
        divergence=space.distance.tolist(),
        distance=filtration.distance.tolist(),
        time=filtration.time.tolist(),
        annexed=filtration.annexed.tolist(),
        annexing=filtration.annexing.tolist(),
        epsilon_max=float(filtration.epsilon_max),
        assignment=concepts.assignment.tolist(),
        concepts=concepts.ids.tolist(),
    )
