"""Labelled clouds and a model -> report: responses, what can be told from them, and how pure the concepts are."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from service import clouds
from service.engine.errors import ShapeConceptsError, UnreadableCloud
from service.engine.model import OnStage, ShapeModel, ignore_stage
from service.model_file import TENSORS, Manifest
from worker.evaluation import measures
from worker.evaluation.labels import LEAST, OTHER, LabelledCloud, judged, read_labels
from worker.evaluation.protocols import (
    DESCRIPTIONS,
    Samples,
    nearest_neighbour,
    region_matrices,
    require,
    support_vectors,
)
from worker.evaluation.report import (
    ConceptPurity,
    Data,
    Figures,
    Grouping,
    JudgedModel,
    Matrices,
    Report,
    SourceFigures,
)

Count = Callable[[Iterable["Answered"], int], Iterable["Answered"]]


class Answered(NamedTuple):
    """What the model says of a cloud.

    Attributes:
        digest: SHA-256 of the cloud's points, in hexadecimal; empty where it could not be read.
        responses: (C,) float64, or why there are none.
    """

    digest: str
    responses: NDArray[np.float64] | ShapeConceptsError


def evaluate(
    model: ShapeModel,
    manifest: Manifest,
    table: Path,
    command: str,
    on_stage: OnStage = ignore_stage,
    count: Count = lambda items, total: items,
) -> Report:
    """Judges a model by labelled clouds; the answering is shared out as `joblib.parallel_config` says.

    Args:
        model: to be judged.
        manifest: of the model.
        table: `labels.csv`.
        command: that was called, for the report.
        on_stage: called as each stage begins.
        count: hands on what it is given, and may show how far that is.

    Raises:
        InvalidParameter: the labels cannot be used, or the clouds or responses are too few to judge by.
    """
    on_stage("labels")
    labelled = read_labels(table)
    judged(labelled)

    on_stage("responses")
    results = Parallel(return_as="generator")(delayed(_answer)(model, cloud) for cloud in labelled)
    answers = list(count(results, len(labelled)))
    places = [place for place, answer in enumerate(answers) if not isinstance(answer.responses, ShapeConceptsError)]
    answered = [labelled[place] for place in places]
    chosen = judged(answered)
    kept = [answered[place] for place in chosen]
    samples = Samples(
        np.stack([np.asarray(answers[places[place]].responses, dtype=np.float64) for place in chosen]),
        np.array([cloud.category for cloud in kept]),
        np.array([cloud.group for cloud in kept]),
    )
    require(samples)

    with threadpool_limits(1):  # sums must not depend on the number of threads
        on_stage("nearest neighbours")
        nearest = nearest_neighbour(samples)

        on_stage("support vectors")
        machines = support_vectors(samples)

    on_stage("region grid")
    regions = region_matrices(samples)

    on_stage("purity")
    categories = {cloud.category for cloud in labelled} - {OTHER}
    labels_of = {answer.digest: cloud.category for answer, cloud in zip(answers, labelled, strict=True)}
    by_label = {
        label: Figures(knn=knn, svm=svm, within=within, assigned=assigned)
        for (label, knn), svm, within, assigned in zip(
            measures.recalls(samples.labels, nearest).items(),
            _mean_recalls(samples.labels, machines),
            np.diag(regions.within).tolist(),
            np.diag(regions.assigned).tolist(),
            strict=True,
        )
    }
    return Report(
        command=command,
        model=JudgedModel(
            name=manifest.name,
            version=manifest.version,
            sha256=manifest.contents[TENSORS].sha256,
            concepts=samples.vectors.shape[1],
            time=manifest.epsilon_max,
        ),
        data=_describe(table, labelled, answers, kept),
        protocol=DESCRIPTIONS | {"judged": f"categories of at least {LEAST} answered clouds, but not '{OTHER}'"},
        figures=_mean(list(by_label.values())),
        by_label=by_label,
        by_source=_by_source(samples.labels, nearest, machines, np.array([cloud.source for cloud in kept])),
        matrices=Matrices(
            labels=list(regions.labels), within=regions.within.tolist(), assigned=regions.assigned.tolist()
        ),
        grouping=group_purity(model, labels_of, sorted(categories)),
    )


def group_purity(model: ShapeModel, labels_of: dict[str, str], categories: Sequence[str]) -> Grouping | None:
    """How pure a model's concepts are.

    Args:
        model: whose prototypes are known by the hashes of their clouds.
        labels_of: the label of each hash.
        categories: that a concept can be pure of; a prototype with another label makes its concept impure.

    Returns:
        None where no concept has a labelled prototype: the model was not trained on these clouds.
    """
    labels = [labels_of.get(digest) for digest in model.prototypes.cloud_hashes]
    concepts = model.concepts()
    known = np.array([label is not None for label in labels])
    inside = known & (concepts.assignment >= 0)
    if not inside.any():
        return None
    members = np.bincount(concepts.assignment[inside], minlength=len(concepts.sizes))
    present = np.flatnonzero(members)
    counts = np.zeros((len(members), len(categories)), np.int64)
    seen = measures.label_counts(concepts.assignment, labels, categories)
    counts[: len(seen)] = seen
    purities = measures.purity(counts[present], members[present])
    scores = measures.rank_score(purities, members[present])
    ranked = [
        ConceptPurity(
            id=int(concepts.ids[concept]),
            prototypes=int(members[concept]),
            label=categories[counts[concept].argmax()] if counts[concept].any() else None,
            purity=float(purities[place]),
            rank_score=float(scores[place]),
        )
        for place, concept in enumerate(present)
    ]
    return Grouping(
        prototypes=int(known.sum()),
        covered=float(inside.sum() / known.sum()),
        purity=float(purities.mean()),
        pure=measures.pure_share(purities),
        concepts=sorted(ranked, key=lambda concept: -concept.rank_score),
    )


def _answer(model: ShapeModel, labelled: LabelledCloud) -> Answered:
    digest = ""
    try:
        cloud = clouds.read(labelled.path.read_bytes(), name=labelled.path.name)
        digest = hashlib.sha256(np.ascontiguousarray(cloud.points).tobytes()).hexdigest()
        with threadpool_limits(1):  # the processes share the cores already
            return Answered(digest, model.respond(cloud).responses)
    except ShapeConceptsError as error:
        return Answered(digest, error)
    except OSError as error:
        return Answered(digest, UnreadableCloud(f"The file cannot be read: {error.strerror}."))


def _describe(table: Path, labelled: list[LabelledCloud], answers: list[Answered], kept: list[LabelledCloud]) -> Data:
    unanswered = {
        cloud.file: str(answer.responses)
        for cloud, answer in zip(labelled, answers, strict=True)
        if isinstance(answer.responses, ShapeConceptsError)
    }
    categories = Counter(cloud.category for cloud in kept)
    answered = Counter(cloud.category for cloud in labelled if cloud.file not in unanswered)
    return Data(
        labels=str(table),
        sha256=hashlib.sha256(table.read_bytes()).hexdigest(),
        clouds=len(labelled),
        judged=len(kept),
        groups=len({cloud.group for cloud in kept}),
        categories=dict(sorted(categories.items())),
        not_judged=dict(sorted((answered - categories).items())),
        unanswered=unanswered,
    )


def _by_source(
    labels: NDArray[np.str_], nearest: NDArray[np.str_], machines: NDArray[np.str_], sources: NDArray[np.str_]
) -> dict[str, SourceFigures]:
    return {
        str(source): SourceFigures(
            clouds=int((sources == source).sum()),
            knn=measures.balanced_accuracy(labels[sources == source], nearest[sources == source]),
            svm=float(np.mean(_mean_recalls(labels[sources == source], machines[:, sources == source]))),
        )
        for source in np.unique(sources)
        if source
    }


def _mean_recalls(labels: NDArray[np.str_], repeated: NDArray[np.str_]) -> list[float]:
    """The recall of each label, sorted, the mean over repetitions."""
    each = [list(measures.recalls(labels, predicted).values()) for predicted in repeated]
    return [float(mean) for mean in np.mean(each, axis=0)]


def _mean(figures: Sequence[Figures]) -> Figures:
    return Figures(**{name: float(np.mean([getattr(f, name) for f in figures])) for name in Figures.model_fields})
