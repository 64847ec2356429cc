"""What each motif level pays: the model learnt anew from the stimuli of some motif levels alone."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array
from threadpoolctl import threadpool_limits

from service.engine.model import ShapeModel
from service.engine.motifs import Ensemble
from service.engine.stimuli import Stimuli
from worker.evaluation.answering import Count
from worker.evaluation.judgement import Recalled, judge_others, judge_recalls
from worker.evaluation.protocols import Samples
from worker.evaluation.report import Ablated, AblatedSet
from worker.learning.train import conceive

DESCRIPTION = (
    "the stimuli of all other motif levels are taken away, of the training objects and of the clouds; tree, "
    "filtration, concepts and metric are learnt anew from what is left, and the responses are judged as the model's own"
)


class Arm(NamedTuple):
    """Some of the motif levels.

    Attributes:
        name: what is left of the hierarchy, in words.
        levels: the motif levels that are left, ascending.
    """

    name: str
    levels: tuple[int, ...]


class LabelledStimuli(NamedTuple):
    """A set's clouds.

    Attributes:
        name: of the set.
        stimuli: of each of the n clouds.
        recalled: their n labels and groups, and what the model's own responses predict.
    """

    name: str
    stimuli: Sequence[Stimuli]
    recalled: Recalled


def arms_of(ensemble: Ensemble) -> tuple[Arm, ...]:
    """Each motif level alone, all up to each one, and the ranks taken out one at a time."""
    *below, top = np.unique(ensemble.vertex_levels).tolist()
    if not below:
        return ()
    unions = below[1:]
    alone = [Arm(f"unions of level {level} alone", (level,)) for level in unions]
    upwards = [Arm(f"levels 1 to {level}", tuple(below[: place + 2])) for place, level in enumerate(unions)]
    without = [
        Arm("all but single segments", (*unions, top)),
        Arm("all but unions", (below[0], top)),
        Arm("all but the whole object", tuple(below)),
    ]
    segments, whole = Arm("single segments alone", (below[0],)), Arm("the whole object alone", (top,))
    ranks = [Arm("unions alone", tuple(unions)), *without] if unions else []
    # the last of `upwards` is all but the whole object, the only level of unions is all of them
    return (segments, *(alone if len(alone) > 1 else ()), whole, *upwards[:-1], *ranks)


def ablate(
    model: ShapeModel, sets: Sequence[LabelledStimuli], count: Count = lambda items, total: items
) -> list[Ablated]:
    """Judges what is left of a model; arms by which no training object is told from another are left out.

    Args:
        model: whose parts are taken away; the work is shared out as `joblib.parallel_config` says.
        sets: the first judges itself and all others.
        count: hands on what it is given, and may show how far that is.
    """
    arms = arms_of(model.ensemble)
    results = Parallel(return_as="generator")(delayed(_ablate)(model, sets, arm) for arm in arms)
    return [each for each in count(results, len(arms)) if each is not None]


def restrict(model: ShapeModel, arm: Arm) -> ShapeModel | None:
    """The model that is learnt from some motif levels; None where fewer than two objects have stimuli there."""
    kept = np.isin(model.ensemble.vertex_levels, arm.levels)
    stimuli = csr_array(model.stimuli @ diags_array(kept.astype(np.float32), format="csr"))
    stimuli.eliminate_zeros()
    stimuli.sort_indices()
    if np.count_nonzero(np.diff(stimuli.indptr)) < 2:
        return None
    return replace(model, stimuli=stimuli, **conceive(stimuli, model.params)._asdict())


def respond_by(model: ShapeModel, arm: Arm, clouds: Iterable[Stimuli]) -> NDArray[np.float64]:
    """Responses (n, K) of a restricted model to clouds of which the unrestricted one gave the stimuli."""
    kept = np.isin(model.ensemble.vertex_levels, arm.levels)
    spectrum = model.spectrum()
    left = ((each, kept[each.indices]) for each in clouds)
    return np.stack([model.compare(Stimuli(s.indices[k], s.values[k]), spectrum).responses for s, k in left])


def _ablate(model: ShapeModel, sets: Sequence[LabelledStimuli], arm: Arm) -> Ablated | None:
    with threadpool_limits(1):
        restricted = restrict(model, arm)
        if restricted is None:
            return None
        samples = [
            Samples(respond_by(restricted, arm, each.stimuli), each.recalled.labels, each.recalled.groups)
            for each in sets
        ]
    recalled = [judge_recalls(samples[0]), *(judge_others(samples[0], each) for each in samples[1:])]
    return Ablated(
        name=arm.name,
        levels=list(arm.levels),
        vertices=int(np.isin(model.ensemble.vertex_levels, arm.levels).sum()),
        concepts=len(restricted.concepts().sizes),
        sets=[
            AblatedSet(name=each.name, intervals=found.intervals(), ahead=each.recalled.ahead_of(found))
            for each, found in zip(sets, recalled, strict=True)
        ],
    )
