"""Labelled clouds and a model -> report, top-down: what can be told from the responses, and from other vectors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed
from threadpoolctl import threadpool_limits

from service.engine.errors import InvalidParameter
from service.engine.model import OnStage, ShapeModel, ignore_stage
from service.model_file import TENSORS, Manifest
from worker.evaluation import (
    ablation,
    baselines,
    bootstrap,
    grouping,
    one_instance,
    parts,
    protocols,
    regions,
    robustness,
)
from worker.evaluation.ablation import LabelledObjects
from worker.evaluation.answering import Answered, AnsweredSet, Count, answer
from worker.evaluation.judgement import Recalled, judge, judge_others, mean_figures
from worker.evaluation.labels import LEAST, OTHER, judged, read_labels
from worker.evaluation.protocols import Samples
from worker.evaluation.report import Grouping, JudgedModel, Matrices, Report, Robustness
from worker.evaluation.vector_files import VectorFile

RESPONSES = "responses"  # what the model's own vectors are called beside the baselines'
DESCRIPTIONS = {
    "judged": f"categories of at least {LEAST} answered clouds, but not '{OTHER}'",
    "intervals": bootstrap.DESCRIPTION,
    "transfer": one_instance.DESCRIPTION,
    "motif levels": ablation.DESCRIPTION,
}


class JudgedOther(NamedTuple):
    """The clouds of another set that are judged, and what is predicted for them by the model, and by each baseline."""

    kept: list[Answered]
    own: Recalled
    rivals: dict[str, Recalled]


@dataclass(frozen=True)
class Request:
    """What a model is judged by.

    Attributes:
        table: `labels.csv`.
        command: that was called, for the report.
        vectors: of other programs, to be judged beside the model.
        others: labels of other clouds, to be judged by the first.
        robustness: whether the clouds are answered under disturbances as well.
    """

    table: Path
    command: str
    vectors: tuple[VectorFile, ...] = ()
    others: tuple[Path, ...] = ()
    robustness: bool = False


def evaluate(
    model: ShapeModel,
    manifest: Manifest,
    request: Request,
    on_stage: OnStage = ignore_stage,
    count: Count = lambda items, total: items,
) -> Report:
    """Judges a model by labelled clouds.

    The work is shared out as `joblib.parallel_config` says; the report is the same on any number of workers.

    Args:
        model: to be judged.
        manifest: of the model.
        request: by what.
        on_stage: called as each stage begins.
        count: hands on what it is given, and may show how far that is.

    Raises:
        InvalidParameter: the labels or vectors cannot be used, or the clouds or responses are too few to judge by.
    """
    on_stage("labels")
    labelled, *labelled_others = [read_labels(table) for table in (request.table, *request.others)]
    _check(request.vectors, [labelled[place].file for place in judged(labelled)])

    on_stage("responses")
    answered = answer(model, request.table, labelled, request.robustness, count)
    others = [
        answer(model, table, rows, False, count) for table, rows in zip(request.others, labelled_others, strict=True)
    ]
    kept = [answered.answered[place] for place in judged([each.cloud for each in answered.answered])]
    samples = _samples(kept, request.vectors)
    for name, each in samples.items():
        protocols.require(each, "the model's responses" if name == RESPONSES else f"the vectors '{name}'")

    on_stage("figures")
    results = Parallel(return_as="generator")(delayed(judge)(each) for each in samples.values())
    judgements = dict(zip(samples, count(results, len(samples)), strict=True))
    own = judgements.pop(RESPONSES)
    by_label = own.by_label()

    on_stage("other sets")
    judged_others = [_judge_other(each, samples, request.vectors) for each in others]

    on_stage("motif levels")
    ablated = ablation.ablate(
        model,
        [
            _objects_of(answered, kept, own.recalled),
            *(_objects_of(each, of.kept, of.own) for each, of in zip(others, judged_others, strict=True)),
        ],
        count,
    )

    on_stage("grouping")
    labels_of = {each.seen.digest: each.cloud.category for each in answered.answered}
    grouped = _judge_grouping(model, answered, labels_of, request.vectors)

    on_stage("one instance a label")
    taught = one_instance.transfer(
        [each.seen for each in kept],
        own.recalled.labels,
        own.recalled.groups,
        model.dictionary,
        {name: each.vectors for name, each in samples.items()},
        count,
    )
    files = {each.name: f"vectors of {each.file}" for each in request.vectors}
    return Report(
        command=request.command,
        model=JudgedModel(
            name=manifest.name,
            version=manifest.version,
            sha256=manifest.contents[TENSORS].sha256,
            concepts=len(model.concepts().sizes),
            responses=own.size,
            time=manifest.epsilon_max,
        ),
        data=parts.data_of(answered, kept),
        protocol=protocols.DESCRIPTIONS | regions.DESCRIPTIONS | grouping.DESCRIPTIONS | DESCRIPTIONS,
        figures=mean_figures(by_label),
        by_label=by_label,
        by_source=parts.by_source(own.recalled, kept),
        matrices=Matrices(
            labels=list(own.regions.labels), within=own.regions.within.tolist(), assigned=own.regions.assigned.tolist()
        ),
        intervals=own.recalled.intervals(),
        map=parts.map_of(own, kept),
        baselines={
            name: parts.baseline_of((baselines.DESCRIPTIONS | files)[name], each, own)
            for name, each in judgements.items()
        },
        grouping=grouped,
        structure=parts.structure_of(model, labels_of),
        transfer=taught,
        others=[
            parts.other_set(parts.data_of(each, of.kept), of.own, of.rivals)
            for each, of in zip(others, judged_others, strict=True)
        ],
        ablation=ablated,
        robustness=_robustness(answered) if request.robustness else None,
    )


def _check(vectors: Sequence[VectorFile], files: Sequence[str]) -> None:
    """Refuses other programs' vectors before the long work if they are of other clouds, or called as others are.

    A cloud that the model will refuse needs no vector, so that not all of them can be asked for here.
    """
    names = [RESPONSES, *baselines.DESCRIPTIONS, *(each.name for each in vectors)]
    if twice := {name for name in names if names.count(name) > 1}:
        raise InvalidParameter(f"The vectors '{min(twice)}' need another name: there are others of that name.")
    for each in vectors:
        if not any(each.has([file]) for file in files):
            each.of(files)


def _samples(clouds: Sequence[Answered], files: Sequence[VectorFile]) -> dict[str, Samples]:
    """The vectors of clouds with their labels: the model's responses first, then the baselines."""
    labels = np.array([each.cloud.category for each in clouds])
    groups = np.array([each.cloud.group for each in clouds])
    vectors = {RESPONSES: np.stack([each.responses for each in clouds])}
    vectors |= {name: np.stack([each.baselines[name] for each in clouds]) for name in baselines.DESCRIPTIONS}
    vectors |= {file.name: file.of([each.cloud.file for each in clouds]) for file in files}
    return {name: Samples(each, labels, groups) for name, each in vectors.items()}


def _judge_other(answered: AnsweredSet, samples: Mapping[str, Samples], files: Sequence[VectorFile]) -> JudgedOther:
    """Judges another set's clouds of the labels that the first set has, by the model and each baseline."""
    kept = [each for each in answered.answered if each.cloud.category in samples[RESPONSES].labels]
    if not kept:
        raise InvalidParameter(f"No cloud of {answered.table} has a label that is judged: {_labels(samples)}.")
    known = [file for file in files if file.has([each.cloud.file for each in kept])]
    recalled = {name: judge_others(samples[name], each) for name, each in _samples(kept, known).items()}
    return JudgedOther(kept, recalled.pop(RESPONSES), recalled)


def _objects_of(answered: AnsweredSet, kept: Sequence[Answered], recalled: Recalled) -> LabelledObjects:
    return LabelledObjects(str(answered.table), [each.seen for each in kept], recalled)


def _judge_grouping(
    model: ShapeModel, answered: AnsweredSet, labels_of: Mapping[str, str], files: Sequence[VectorFile]
) -> Grouping | None:
    known = grouping.labelled_prototypes(model, labels_of, sorted(set(labels_of.values()) - {OTHER}))
    if known is None:
        return None
    by_digest = {each.seen.digest: each for each in answered.answered}
    clouds = [by_digest[digest] for digest in known.digests]
    usable = [file for file in files if file.has([each.cloud.file for each in clouds])]
    vectors = {name: each.vectors for name, each in _samples(clouds, usable).items() if name != RESPONSES}
    with threadpool_limits(1):  # sums must not depend on the number of threads
        return grouping.judge_grouping(known, vectors)


def _robustness(answered: AnsweredSet) -> Robustness:
    best = np.array([each.best for each in answered.answered], dtype=np.int64)
    return robustness.curves(best, [each.disturbed for each in answered.answered])


def _labels(samples: Mapping[str, Samples]) -> str:
    return ", ".join(np.unique(samples[RESPONSES].labels).tolist())
