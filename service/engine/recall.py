"""What a model recalls of its training objects, and where another model's training objects stand among its own.

A model keeps the description of every constellation of every training object as a motif prototype, with its motif
level and the share of the surface that it covers. That is all that Eq. 1 asks of an object (unless vertices fire by
words), so that one model can be stimulated with what another one learnt from, without the clouds and bit for bit as
with them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from service.engine.divergence import sparse_jsd
from service.engine.model import ShapeModel
from service.engine.motifs import Constellations
from service.engine.novelty import divergences_from
from service.engine.stimuli import Stimuli, stimulate

NOVEL = 0.95  # an object of this novelty or more is like nothing that a model has learnt
NOWHERE = -1


class Recalled(NamedTuple):
    """A training object, as a model remembers it.

    Attributes:
        constellations: C of them, with their levels and coverage; which segments each has, and how they are joined, is
            not kept: (C, 0) and (0, 2).
        descriptors: (C, D) float32: of the constellations.
        whole: (D,) float32: of the whole object.
    """

    constellations: Constellations
    descriptors: NDArray[np.float32]
    whole: NDArray[np.float32]


def sees_as(model: ShapeModel, other: ShapeModel) -> bool:
    """Whether a model can be asked about what another one recalls: both describe objects in the same way."""
    stages = ("cloud", "patches", "segments", "descriptor", "hierarchy")
    same = all(getattr(model.params, stage) == getattr(other.params, stage) for stage in stages)
    return same and model.params.stimuli.gating != "words"


def recall(model: ShapeModel, objects: Sequence[int]) -> Iterator[Recalled]:
    """What a model recalls of some of its training objects.

    Args:
        model: that learnt from them.
        objects: their numbers.
    """
    hierarchy, ensemble = model.ensemble.hierarchies[0], model.ensemble
    level_of = np.array([level for level, _ in hierarchy.vertices], np.int64)
    memorised = hierarchy.prototypes.tocsc()
    first = np.searchsorted(ensemble.objects, np.arange(len(model.prototypes.cloud_hashes) + 1))
    for number in objects:
        start, end = first[number : number + 2]
        kept = slice(memorised.indptr[start], memorised.indptr[end])
        constellation = np.repeat(np.arange(end - start), np.diff(memorised.indptr[start : end + 1]))
        constellations = Constellations(
            members=np.zeros((end - start, 0), dtype=bool),
            levels=np.stack([level_of[memorised.indices[kept]], constellation], axis=1),
            edges=np.zeros((0, 2), np.int64),
            propagations=np.zeros((0, 2), np.int64),
            coverage=ensemble.coverage[start:end],
            truncated=False,
        )
        yield Recalled(
            constellations,
            descriptors=ensemble.prototypes[start:end],
            whole=ensemble.prototypes[model.novelty_scale.wholes[number]],
        )


def stimulate_again(model: ShapeModel, recalled: Recalled) -> Stimuli:
    """The stimuli that an object gives a model, by what some model remembers of it.

    Args:
        model: that is asked; it `sees_as` the one that remembers, so that words play no part.
        recalled: the object.
    """
    words = np.zeros((0, len(model.dictionary.levels)), np.int64)
    return stimulate(model.ensemble, recalled.constellations, recalled.descriptors, words, model.params.stimuli)


def place(model: ShapeModel, recalled: Sequence[Recalled] | Iterator[Recalled]) -> Iterator[int]:
    """The training object of a model by which an object would join its topological space; `NOWHERE` if it is novel.

    That is the nearest one by the JSD of the stimuli, as edges of the spanning tree are chosen (Sec. Topological Space
    Generation); of equally near ones the first. Nearest to a training object is itself. Of the 250 objects of the
    default model, each left out in turn, 95 % stand by one of their own concept, or of none as they; by the metric of
    concept responses (Eq. 4), which sees 16 dimensions, 66 %.

    Args:
        model: that is asked; it `sees_as` the one that recalls them.
        recalled: objects, as some model remembers them.
    """
    rows = csr_array(model.stimuli.astype(np.float64))
    rows.sort_indices()
    start, column, value = rows.indptr.astype(np.int64), rows.indices.astype(np.int64), _normalised(rows)
    for each in recalled:
        divergence = divergences_from(each.whole, model.wholes).min()
        if model.novelty_scale.novelty(float(divergence)) >= NOVEL:
            yield NOWHERE
            continue
        stimuli = stimulate_again(model, each)
        asked = _dense(stimuli, rows.shape[1])
        filled = len(stimuli.indices) > 0
        apart = [sparse_jsd(asked, filled, column, value, start[i], start[i + 1]) for i in range(rows.shape[0])]
        yield int(np.argmin(apart))


def _normalised(rows: csr_array) -> NDArray[np.float64]:
    total = np.asarray(rows.sum(axis=1)).ravel()
    return np.asarray(rows.data / np.repeat(np.where(total > 0, total, 1.0), np.diff(rows.indptr)))


def _dense(stimuli: Stimuli, dimensions: int) -> NDArray[np.float64]:
    dense = np.zeros(dimensions)
    dense[stimuli.indices] = stimuli.values
    return dense / max(dense.sum(), 1e-300)
