"""What each motif level pays: the model learnt anew from the stimuli of some motif levels alone."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array
from threadpoolctl import threadpool_limits

from service.engine.model import ShapeModel
from service.engine.motifs import Constellations, Ensemble
from service.engine.perception import Perception
from service.engine.stimuli import Stimuli, stimulate
from worker.evaluation.answering import Count
from worker.evaluation.judgement import Recalled, judge_others, judge_recalls
from worker.evaluation.protocols import Samples
from worker.evaluation.report import Ablated, AblatedSet
from worker.learning.observations import Observation
from worker.learning.stimuli import stack
from worker.learning.train import conceive

NO_WORDS = np.zeros((0, 0), np.int64)
SAME = 1e-9  # responses that differ by less are equal but for rounding
DESCRIPTION = (
    "the motif vertices of all other levels are taken away; tree, filtration, concepts and metric are learnt anew from "
    "the stimuli that are left, and the responses are judged as the model's own. What is taken away is what was "
    "learnt, not what a cloud is asked with: where constellations are told by their rank, vertices of unions are "
    "excited by all unions of the cloud, the largest being its whole, and each level's share among them stays. Ranks "
    "that weigh nothing in such a model weigh 1 here"
)


class Arm(NamedTuple):
    """Some of the motif levels.

    Attributes:
        name: what is left of the hierarchy, in words.
        levels: the motif levels that are left, ascending.
    """

    name: str
    levels: tuple[int, ...]


class LabelledObjects(NamedTuple):
    """A set's clouds.

    Attributes:
        name: of the set.
        objects: n of them, as the model sees them.
        recalled: their n labels and groups, and what the model's own responses predict.
    """

    name: str
    objects: Sequence[Observation]
    recalled: Recalled


def arms_of(ensemble: Ensemble, whole_apart: bool = True) -> tuple[Arm, ...]:
    """Each motif level alone, all up to each one, and the ranks taken out one at a time.

    Args:
        ensemble: HE.
        whole_apart: whether the highest motif level is that of wholes.
    """
    highest = "the whole object" if whole_apart else "the highest motif level"
    *below, top = np.unique(ensemble.vertex_levels).tolist()
    if not below:
        return ()
    unions = below[1:]
    alone = [Arm(f"unions of level {level} alone", (level,)) for level in unions]
    upwards = [Arm(f"levels 1 to {level}", tuple(below[: place + 2])) for place, level in enumerate(unions)]
    without = [
        Arm("all but single segments", (*unions, top)),
        Arm("all but unions", (below[0], top)),
        Arm(f"all but {highest}", tuple(below)),
    ]
    segments, whole = Arm("single segments alone", (below[0],)), Arm(f"{highest} alone", (top,))
    ranks = [Arm("unions alone", tuple(unions)), *without] if unions else []
    # the last of `upwards` is all but the whole object, the only level of unions is all of them
    every = Arm("all motif levels", (*below, top))
    return (segments, *(alone if len(alone) > 1 else ()), whole, *upwards[:-1], *ranks, every)


def ablate(
    model: ShapeModel, sets: Sequence[LabelledObjects], count: Count = lambda items, total: items
) -> list[Ablated]:
    """Judges what is left of a model; arms whose responses are the same for all clouds are left out.

    Args:
        model: whose parts are taken away; the work is shared out as `joblib.parallel_config` says.
        sets: the first judges itself and all others.
        count: hands on what it is given, and may show how far that is.
    """
    with threadpool_limits(1):
        evened = even(model)
        stimuli = [stimuli_of(evened, each.objects) for each in sets]
    arms = arms_of(model.ensemble, model.params.hierarchy.whole_apart)
    recalled = [(each.name, each.recalled) for each in sets]
    results = Parallel(return_as="generator")(delayed(_ablate)(evened, recalled, stimuli, arm) for arm in arms)
    return [each for each in count(results, len(arms)) if each is not None]


def even(model: ShapeModel) -> ShapeModel:
    """The model with the stimuli that its training objects have where ranks that weigh nothing count as 1.

    Only where ranks are what constellations are told by: of the training objects' words no other trace is left than
    the vertices that they activate. And only where all training objects are memorised, with all their constellations.
    """
    params = model.params.stimuli
    weights = ("segment_weight", "union_weight", "whole_weight")
    silent = {name: 1.0 for name in weights if getattr(params, name) == 0}
    sampled = model.stimuli.shape[0] > model.params.hierarchy.max_objects
    if not silent or not params.balanced or params.gating != "rank" or sampled:
        return model
    params = params.model_copy(update=silent)
    ensemble = model.ensemble
    rows = [
        stimulate(ensemble, seen, ensemble.prototypes[own], NO_WORDS, params) for seen, own in _remembered(ensemble)
    ]
    return replace(
        model, params=model.params.model_copy(update={"stimuli": params}), stimuli=stack(rows, ensemble.vertex_count)
    )


def stimuli_of(model: ShapeModel, objects: Iterable[Observation | Perception]) -> list[Stimuli]:
    """Of objects that were perceived already."""
    params, ensemble, dictionary = model.params.stimuli, model.ensemble, model.dictionary
    return [
        stimulate(ensemble, o.constellations, o.descriptors, dictionary.words(o.segment_descriptors), params)
        for o in objects
    ]


def _remembered(ensemble: Ensemble) -> Iterator[tuple[Constellations, NDArray[np.int64]]]:
    """What the ensemble remembers of each training object: its constellations, and their motif prototypes."""
    hierarchy = ensemble.hierarchies[0]  # every constellation is in each of them, on the same motif levels
    vertex, prototype = hierarchy.prototypes.nonzero()
    level = np.array([motif[0] for motif in hierarchy.vertices])[vertex]
    for number in range(int(ensemble.objects.max()) + 1):
        own = np.flatnonzero(ensemble.objects == number)
        here = (prototype >= own[0]) & (prototype <= own[-1])
        rows = np.unique(np.column_stack([level[here], prototype[here] - own[0]]), axis=0)
        nothing, pairs = np.zeros((len(own), 0), bool), np.zeros((0, 2), np.int64)
        yield Constellations(nothing, rows, pairs, pairs, ensemble.coverage[own], truncated=False), own


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


def _ablate(
    model: ShapeModel, sets: Sequence[tuple[str, Recalled]], stimuli: Sequence[Sequence[Stimuli]], arm: Arm
) -> Ablated | None:
    with threadpool_limits(1):
        restricted = restrict(model, arm)
        if restricted is None:
            return None
        samples = [
            Samples(respond_by(restricted, arm, of), own.labels, own.groups)
            for (_, own), of in zip(sets, stimuli, strict=True)
        ]
    if not tells_apart(samples[0].vectors):
        return None
    recalled = [judge_recalls(samples[0]), *(judge_others(samples[0], each) for each in samples[1:])]
    return Ablated(
        name=arm.name,
        levels=list(arm.levels),
        vertices=int(np.isin(model.ensemble.vertex_levels, arm.levels).sum()),
        concepts=len(restricted.concepts().sizes),
        sets=[
            AblatedSet(name=name, intervals=found.intervals(), ahead=own.ahead_of(found))
            for (name, own), found in zip(sets, recalled, strict=True)
        ],
    )


def tells_apart(responses: NDArray[np.float64]) -> bool:
    """Whether at least two responses (n, K) differ between clouds: of fewer no protocol can tell anything."""
    return int((np.ptp(responses, axis=0) > SAME).sum()) >= 2
