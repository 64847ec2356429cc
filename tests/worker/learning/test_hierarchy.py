"""Growing the hierarchies: every constellation of every object is memorised where it belongs, and nothing else."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from service.engine.motifs import Motif
from service.engine.novelty import whole_of
from service.engine.params import ModelParams
from tests.learnt import PRESETS, learnt, named_clouds, perceived
from worker.learning.hierarchy import grow_ensemble, sample
from worker.learning.observations import Observation, observe

presets = pytest.mark.parametrize("preset", PRESETS)


def occurrences(preset: str, f: int) -> list[tuple[int, Motif, int]]:
    """Prototype, motif and row of the constellations of all objects in hierarchy f: what is to be memorised where."""
    model, found, first = learnt(preset), [], 0
    for seen in perceived(preset):
        words = model.dictionary.words(seen.segment_descriptors)[:, f]
        for row, (level, c) in enumerate(seen.constellations.levels.tolist()):
            members = np.flatnonzero(seen.constellations.members[c])
            found.append((first + c, (level, tuple(sorted(words[members].tolist()))), row))
        first += len(seen.descriptors)
    return found


@presets
def test_the_prototypes_are_the_descriptions_of_all_constellations(preset: str):
    ensemble = learnt(preset).ensemble
    assert np.array_equal(ensemble.prototypes, np.concatenate([p.descriptors for p in perceived(preset)]))
    for index, seen in enumerate(perceived(preset)):
        assert np.array_equal(ensemble.prototypes[ensemble.objects == index], seen.descriptors)


@presets
def test_every_constellation_is_memorised_exactly_by_the_vertex_of_its_motif(preset: str):
    for f, hierarchy in enumerate(learnt(preset).ensemble.hierarchies):
        expected: dict[Motif, set[int]] = {}
        for prototype, motif, _ in occurrences(preset, f):
            expected.setdefault(motif, set()).add(prototype)
        memory = {m: set(hierarchy.prototypes[[v]].indices.tolist()) for v, m in enumerate(hierarchy.vertices)}
        assert memory == expected
        assert (hierarchy.prototypes.data == 1).all()
        assert hierarchy.prototypes.shape[1] == len(learnt(preset).ensemble.prototypes)


@presets
def test_a_motif_stands_once(preset: str):
    for hierarchy in learnt(preset).ensemble.hierarchies:
        assert len(set(hierarchy.vertices)) == len(hierarchy.vertices)
        assert all(hierarchy.vertices[v] == motif for motif, v in hierarchy.index.items())


@presets
def test_edges_and_propagations_are_those_of_the_objects(preset: str):
    model = learnt(preset)
    for f, hierarchy in enumerate(model.ensemble.hierarchies):
        edges, propagations = set(), set()
        for seen in perceived(preset):
            constellations = seen.constellations
            motifs = constellations.motifs(model.dictionary.words(seen.segment_descriptors)[:, f])
            vertex = [hierarchy.index[m] for m in motifs]
            edges |= {tuple(sorted((vertex[a], vertex[b]))) for a, b in constellations.edges}
            propagations |= {(vertex[a], vertex[b]) for a, b in constellations.propagations}
        assert list(map(tuple, hierarchy.edges.tolist())) == sorted(edges)
        assert list(map(tuple, hierarchy.propagations.tolist())) == sorted(propagations)
        level = [motif[0] for motif in hierarchy.vertices]
        assert all(level[a] == level[b] for a, b in hierarchy.edges)
        assert all(level[a] + 1 == level[b] for a, b in hierarchy.propagations)


@presets
def test_propagations_only_add_words(preset: str):
    for hierarchy in learnt(preset).ensemble.hierarchies:
        for a, b in hierarchy.propagations.tolist():
            rest = list(hierarchy.vertices[b][1])
            for word in hierarchy.vertices[a][1]:
                rest.remove(word)  # fails where the union lacks a word of its part


def test_finer_words_make_more_vertices():
    counts = [len(h.vertices) for h in learnt().ensemble.hierarchies]
    assert counts == sorted(counts)
    assert counts[0] < counts[-1]


def test_growing_one_object_at_a_time_adds_to_what_was_there():
    dictionary, seen = learnt().dictionary, perceived()
    few, all_ = grow_ensemble(seen[:5], dictionary), grow_ensemble(seen, dictionary)
    for a, b in zip(few.hierarchies, all_.hierarchies, strict=True):
        assert b.vertices[: len(a.vertices)] == a.vertices
        assert set(map(tuple, a.edges.tolist())) <= set(map(tuple, b.edges.tolist()))
        for v in range(len(a.vertices)):
            assert set(a.prototypes[[v]].indices) <= set(b.prototypes[[v]].indices)


@cache
def observed() -> tuple[Observation, ...]:
    return tuple(o for o in observe(named_clouds(9), ModelParams()) if isinstance(o, Observation))


def test_a_sample_hangs_on_the_clouds_alone_and_not_on_their_order():
    objects = list(observed())
    picked = {objects[number].digest for number in sample(objects, 4)}
    assert len(picked) == 4
    assert {objects[::-1][number].digest for number in sample(objects[::-1], 4)} == picked
    assert sample(objects, 4).tolist() == sorted(sample(objects, 4).tolist())
    assert sample(objects, 9).tolist() == sample(objects, 1000).tolist() == list(range(9))


def test_an_added_cloud_takes_the_place_of_one_at_most():
    objects = list(observed())
    before = {objects[number].digest for number in sample(objects[:8], 4)}
    assert len(before - {objects[number].digest for number in sample(objects, 4)}) <= 1


def test_of_objects_outside_the_sample_the_wholes_alone_are_kept():
    objects, dictionary = list(observed()), learnt().dictionary
    few = np.array([1, 4, 6])
    ensemble, alone = (
        grow_ensemble(objects, dictionary, few),
        grow_ensemble([objects[k] for k in few], dictionary),
    )
    for number, o in enumerate(objects):
        own = ensemble.prototypes[ensemble.objects == number]
        expected = o.descriptors if number in few else o.descriptors[[whole_of(o.constellations)]]
        assert np.array_equal(own, expected)
    for ours, theirs in zip(ensemble.hierarchies, alone.hierarchies, strict=True):
        assert ours.vertices == theirs.vertices
        assert np.array_equal(ours.edges, theirs.edges)
        assert np.array_equal(ours.propagations, theirs.propagations)
        for v in range(len(ours.vertices)):
            memories, same = (h.prototypes.indices[slice(*h.prototypes.indptr[v : v + 2])] for h in (ours, theirs))
            assert np.array_equal(ensemble.prototypes[memories], alone.prototypes[same])
