"""Growing the shape motif hierarchy ensemble (Sec. Hierarchical Object Decomposition and Representation)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from service.engine.dictionary import Dictionary
from service.engine.motifs import Ensemble, Hierarchy, Motif
from worker.learning.observations import Observation

Pair = tuple[int, int]


def grow_ensemble(objects: Sequence[Observation], dictionary: Dictionary) -> Ensemble:
    """Propagates all training objects through one hierarchy for each level of the dictionary.

    A new motif becomes a vertex; each constellation's description is memorised as a motif prototype of its vertex.
    """
    words = [dictionary.words(o.segment_descriptors) for o in objects]
    sizes = [len(o.descriptors) for o in objects]
    first = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    return Ensemble(
        hierarchies=tuple(
            _grow_hierarchy(objects, [w[:, f] for w in words], first, sum(sizes)) for f in range(len(dictionary.levels))
        ),
        prototypes=np.concatenate([o.descriptors for o in objects]),
        objects=np.repeat(np.arange(len(objects)), sizes),
        coverage=np.concatenate([o.constellations.coverage for o in objects]),
    )


def _grow_hierarchy(
    objects: Sequence[Observation], words: Sequence[NDArray[np.int64]], first: NDArray[np.int64], prototypes: int
) -> Hierarchy:
    """H_f, from each object's words on level f; `first` is the place of each object's first prototype."""
    index: dict[Motif, int] = {}
    members: set[Pair] = set()
    edges: set[Pair] = set()
    propagations: set[Pair] = set()
    for seen, of_object, start in zip(objects, words, first.tolist(), strict=True):
        constellations = seen.constellations
        vertex = [index.setdefault(motif, len(index)) for motif in constellations.motifs(of_object)]
        members.update(zip(vertex, (start + constellations.levels[:, 1]).tolist(), strict=True))
        for a, b in constellations.edges.tolist():
            edges.add((min(vertex[a], vertex[b]), max(vertex[a], vertex[b])))
        propagations.update((vertex[a], vertex[b]) for a, b in constellations.propagations.tolist())
    rows, columns = _pairs(members).T
    return Hierarchy(
        vertices=tuple(index),
        prototypes=csr_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(len(index), prototypes)),
        edges=_pairs(edges),
        propagations=_pairs(propagations),
    )


def _pairs(pairs: set[Pair]) -> NDArray[np.int64]:
    return np.array(sorted(pairs), dtype=np.int64).reshape(-1, 2)
