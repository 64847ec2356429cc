"""Growing the shape motif hierarchy ensemble (Sec. Hierarchical Object Decomposition and Representation)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from service.engine.dictionary import Dictionary
from service.engine.motifs import Ensemble, Hierarchy, Motif
from service.engine.novelty import whole_of
from worker.learning.observations import Observation

Pair = tuple[int, int]


def sample(objects: Sequence[Observation], count: int) -> NDArray[np.int64]:
    """At most `count` objects, ascending: those of the smallest content hashes.

    The hash makes it a fair sample that hangs on nothing but the clouds: not on their order, nor on a seed; and of
    clouds that are added later, each takes the place of at most one. It is what k minimum values sketches rest on.
    """
    by_hash = sorted(range(len(objects)), key=lambda number: (objects[number].digest, number))
    return np.array(sorted(by_hash[:count]), dtype=np.int64)


def grow_ensemble(
    objects: Sequence[Observation], dictionary: Dictionary, memorised: NDArray[np.int64] | None = None
) -> Ensemble:
    """Propagates training objects through one hierarchy for each level of the dictionary.

    A new motif becomes a vertex; each constellation's description is memorised as a motif prototype of its vertex.

    Args:
        objects: N of them.
        dictionary: of visual words.
        memorised: which objects are propagated, ascending; of the others the wholes are kept, and are of no vertex.
            None for all.
    """
    everything = np.arange(len(objects)) if memorised is None else memorised
    grown = [objects[number] for number in everything.tolist()]
    words = [dictionary.words(o.segment_descriptors) for o in grown]
    kept = [np.array([whole_of(o.constellations)]) for o in objects]
    for number, o in zip(everything.tolist(), grown, strict=True):
        kept[number] = np.arange(len(o.descriptors))
    sizes = [len(rows) for rows in kept]
    first = np.concatenate([[0], np.cumsum(sizes)[:-1]])[everything]
    return Ensemble(
        hierarchies=tuple(
            _grow_hierarchy(grown, [w[:, f] for w in words], first, sum(sizes)) for f in range(len(dictionary.levels))
        ),
        prototypes=np.concatenate([o.descriptors[rows] for o, rows in zip(objects, kept, strict=True)]),
        objects=np.repeat(np.arange(len(objects)), sizes),
        coverage=np.concatenate([o.constellations.coverage[rows] for o, rows in zip(objects, kept, strict=True)]),
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
