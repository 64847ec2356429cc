"""Labelled clouds and a model -> what is judged of each: every cloud is read and answered once."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from service import clouds
from service.engine.cloud import PointCloud
from service.engine.errors import ShapeConceptsError, UnreadableCloud
from service.engine.model import Response, ShapeModel
from service.engine.perception import perceive
from worker.evaluation.baselines import describe_whole, see_whole
from worker.evaluation.labels import LabelledCloud
from worker.evaluation.robustness import REFUSED, disturbed
from worker.learning.observations import Observation
from worker.learning.prototypes import draw_thumbnail

Count = Callable[[Iterable[Any], int], Iterable[Any]]


@dataclass(frozen=True)
class Answered:
    """What is judged of a cloud.

    Attributes:
        cloud: with its label.
        responses: (C,) float64.
        best: id of the concept that it resembles most.
        seen: the object as the model sees it.
        baselines: its vectors, by the baselines' names.
        disturbed: (S,) int64: its best concepts under each disturbance; empty where they were not asked for.
    """

    cloud: LabelledCloud
    responses: NDArray[np.float64]
    best: int
    seen: Observation
    baselines: dict[str, NDArray[np.float64]]
    disturbed: NDArray[np.int64]


@dataclass(frozen=True)
class Refused:
    """A cloud that is in no figure, and why."""

    cloud: LabelledCloud
    error: ShapeConceptsError


@dataclass(frozen=True)
class AnsweredSet:
    """A labels' file, and what became of its clouds.

    Attributes:
        table: the file.
        answered: in the order of its rows.
        refused: in the order of its rows.
    """

    table: Path
    answered: tuple[Answered, ...]
    refused: tuple[Refused, ...]


def answer(
    model: ShapeModel, table: Path, labelled: Sequence[LabelledCloud], disturb: bool, count: Count
) -> AnsweredSet:
    """Answers the clouds of a labels' file; the work is shared out as `joblib.parallel_config` says.

    Args:
        model: to be judged.
        table: the labels' file.
        labelled: its rows.
        disturb: whether the clouds are answered under every disturbance as well.
        count: hands on what it is given, and may show how far that is.
    """
    results = Parallel(return_as="generator")(delayed(_answer)(model, cloud, disturb) for cloud in labelled)
    answers = list(count(results, len(labelled)))
    return AnsweredSet(
        table=table,
        answered=tuple(each for each in answers if isinstance(each, Answered)),
        refused=tuple(each for each in answers if isinstance(each, Refused)),
    )


def _answer(model: ShapeModel, labelled: LabelledCloud, disturb: bool) -> Answered | Refused:
    try:
        cloud = clouds.read(labelled.path.read_bytes(), name=labelled.path.name)
        with threadpool_limits(1):  # the processes share the cores already
            return _judge(model, labelled, cloud, disturb)
    except ShapeConceptsError as error:
        return Refused(labelled, error)
    except OSError as error:
        return Refused(labelled, UnreadableCloud(f"The file cannot be read: {error.strerror}."))


def _judge(model: ShapeModel, labelled: LabelledCloud, cloud: PointCloud, disturb: bool) -> Answered:
    digest = hashlib.sha256(np.ascontiguousarray(cloud.points).tobytes()).hexdigest()
    response = model.respond(cloud)
    seen, whole = perceive(cloud, model.params), see_whole(cloud, model.params.cloud)
    under = [_best_under(model, other) for other in disturbed(cloud, whole, digest)] if disturb else []
    return Answered(
        cloud=labelled,
        responses=np.asarray(response.responses, dtype=np.float64),
        best=_best(response),
        seen=Observation(labelled.file, digest, seen.constellations, seen.descriptors, draw_thumbnail(seen.graph)),
        baselines=describe_whole(whole),
        disturbed=np.array(under, dtype=np.int64),
    )


def _best_under(model: ShapeModel, cloud: PointCloud) -> int:
    """The id of the best concept, `REFUSED` where there is none."""
    try:
        return _best(model.respond(cloud))
    except ShapeConceptsError:
        return REFUSED


def _best(response: Response) -> int:
    return int(response.concept_ids[response.ranking[0]])
