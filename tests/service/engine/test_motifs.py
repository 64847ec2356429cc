"""Propagation of constellations, against the paper's words with plain sets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from service.engine.motifs import Constellations, propagate
from service.engine.params import HierarchyParams
from service.engine.segments import SegmentGraph
from tests.learnt import PRESETS, learnt, perceived
from tests.service.engine.seen import seen
from tests.shapes import corner_view, cube

wholes = pytest.mark.parametrize("apart", [False, True], ids=["the whole last", "the whole apart"])
Set = frozenset[int]
Edges = list[tuple[int, int]]


@pytest.fixture(scope="module")
def three_faces() -> SegmentGraph:
    return seen(cube(0.12), corner_view(0, 0.9)).graph


@pytest.fixture
def graph_of(three_faces: SegmentGraph):
    def make(count: int, edges: Edges, share: list[float] | None = None) -> SegmentGraph:
        shares = np.array(share or [2.0**-s for s in range(count)])
        joined = np.array(sorted((min(e), max(e)) for e in edges), dtype=np.int64).reshape(-1, 2)
        return replace(three_faces, share=shares / shares.sum(), edges=joined)

    return make


def plain(count: int, edges: Edges) -> tuple[list[set[Set]], list[set[frozenset[Set]]]]:
    """Motif levels and the edges on each, as the paper tells it."""
    level = {frozenset([s]) for s in range(count)}
    joined = {frozenset([frozenset([a]), frozenset([b])]) for a, b in edges}
    levels, all_edges = [level], [joined]
    while joined:
        level = {a | b for a, b in joined}
        joined = {frozenset([a, b]) for a in level for b in level if a != b and a & b}
        levels.append(level)
        all_edges.append(joined)
    return levels, all_edges


def as_sets(found: Constellations) -> list[Set]:
    return [frozenset(np.flatnonzero(found.members[c]).tolist()) for _, c in found.levels]


def levels_of(found: Constellations) -> dict[int, set[Set]]:
    sets = as_sets(found)
    return {
        level: {s for s, (n, _) in zip(sets, found.levels, strict=True) if n == level}
        for level in np.unique(found.levels[:, 0]).tolist()
    }


def wide(apart: bool) -> HierarchyParams:
    return HierarchyParams(max_constellations=4096, max_levels=12, whole_apart=apart)


def expected_levels(count: int, edges: Edges, apart: bool) -> dict[int, set[Set]]:
    """Those of the paper, and the whole: once more above all others, or where the paper's end without it."""
    levels, whole = plain(count, edges)[0], {frozenset(range(count))}
    if apart:
        return {**dict(enumerate(levels, start=1)), 13: whole}
    return dict(enumerate(levels if levels[-1] == whole else [*levels, whole], start=1))


def chain(n: int) -> Edges:
    return [(i, i + 1) for i in range(n - 1)]


CONNECTED = {
    "one segment": (1, []),
    "two": (2, [(0, 1)]),
    "a chain of 3": (3, chain(3)),
    "a triangle": (3, [(0, 1), (0, 2), (1, 2)]),
    "a chain of 5": (5, chain(5)),
    "a chain of 7": (7, chain(7)),
    "a star": (5, [(0, i) for i in range(1, 5)]),
    "a ring": (5, [*chain(5), (0, 4)]),
    "a square with its diagonals": (4, [(a, b) for a in range(4) for b in range(a)]),
    "a tree": (6, [(0, 1), (0, 2), (1, 3), (1, 4), (4, 5)]),
}
DISCONNECTED = {
    "two apart": (2, []),
    "three apart": (3, []),
    "a pair and one": (3, [(0, 2)]),
    "two chains": (6, [(0, 1), (1, 2), (3, 4), (4, 5)]),
}


@wholes
@pytest.mark.parametrize("name", CONNECTED)
def test_constellations_propagate_as_the_paper_says(graph_of, name: str, apart: bool):
    found = propagate(graph_of(*CONNECTED[name]), wide(apart))
    assert levels_of(found) == expected_levels(*CONNECTED[name], apart)
    assert plain(*CONNECTED[name])[0][-1] == {frozenset(range(CONNECTED[name][0]))}
    assert not found.truncated


@wholes
@pytest.mark.parametrize("name", DISCONNECTED)
def test_the_whole_object_is_added_where_nothing_joins_its_parts(graph_of, name: str, apart: bool):
    found = propagate(graph_of(*DISCONNECTED[name]), wide(apart))
    assert levels_of(found) == expected_levels(*DISCONNECTED[name], apart)
    assert not found.truncated


@wholes
@pytest.mark.parametrize("name", {**CONNECTED, **DISCONNECTED})
def test_edges_join_what_is_adjacent_or_shares_a_segment(graph_of, name: str, apart: bool):
    count, edges = {**CONNECTED, **DISCONNECTED}[name]
    found = propagate(graph_of(count, edges), wide(apart))
    sets = as_sets(found)
    joined = {(int(found.levels[a, 0]), frozenset([sets[a], sets[b]])) for a, b in found.edges}
    expected = {(level, e) for level, on_level in enumerate(plain(count, edges)[1], start=1) for e in on_level}
    assert joined == expected
    assert (found.levels[found.edges[:, 0], 0] == found.levels[found.edges[:, 1], 0]).all()


@wholes
@pytest.mark.parametrize("name", {**CONNECTED, **DISCONNECTED})
def test_propagations_lead_from_each_end_of_an_edge_to_its_union(graph_of, name: str, apart: bool):
    count, edges = {**CONNECTED, **DISCONNECTED}[name]
    found = propagate(graph_of(count, edges), wide(apart))
    sets = as_sets(found)
    rows = {(int(level), sets[row]): row for row, (level, _) in enumerate(found.levels)}
    expected = set()
    for a, b in found.edges.tolist():
        union = rows[int(found.levels[a, 0]) + 1, sets[a] | sets[b]]
        expected |= {(a, union), (b, union)}
    assert {(a, b) for a, b in found.propagations.tolist()} == expected
    assert len(found.propagations) == len(expected)


@wholes
@pytest.mark.parametrize("name", {**CONNECTED, **DISCONNECTED})
def test_segments_come_first_and_no_set_stands_twice(graph_of, name: str, apart: bool):
    count, edges = {**CONNECTED, **DISCONNECTED}[name]
    found = propagate(graph_of(count, edges), wide(apart))
    assert np.array_equal(found.members[:count], np.eye(count, dtype=bool))
    assert len(np.unique(found.members, axis=0)) == len(found.members)
    assert len(np.unique(found.levels, axis=0)) == len(found.levels)
    assert np.allclose(found.coverage, found.members @ graph_of(count, edges).share)


@wholes
@pytest.mark.parametrize("most", [1, 2, 5, 24])
@pytest.mark.parametrize("count", [8, 16, 24])
def test_however_many_constellations_the_largest_stay_and_the_whole_is_there(
    graph_of, count: int, most: int, apart: bool
):
    edges = [(a, b) for b in range(count) for a in range(b)]
    graph = graph_of(count, edges)
    params = HierarchyParams(max_constellations=most, max_levels=12, whole_apart=apart)
    found = propagate(graph, params)
    sets = as_sets(found)
    assert found.truncated
    assert frozenset(range(count)) in sets
    second = [found.coverage[c] for level, c in found.levels if level == 2]
    every = sorted((graph.share[a] + graph.share[b] for a, b in edges), reverse=True)
    assert np.allclose(sorted(second, reverse=True), every[:most])
    assert len(found.levels) <= count + 12 * most + 1
    again = propagate(graph, params)
    assert np.array_equal(found.members, again.members)
    assert np.array_equal(found.levels, again.levels)


def test_of_equally_large_constellations_those_of_the_larger_segments_stay(graph_of):
    found = propagate(graph_of(6, chain(6), [1.0] * 6), HierarchyParams(max_constellations=2))
    assert levels_of(found)[2] == {frozenset([0, 1]), frozenset([1, 2])}


@wholes
def test_too_many_levels_are_reported_and_the_whole_is_there(graph_of, apart: bool):
    params = HierarchyParams(max_constellations=4096, max_levels=3, whole_apart=apart)
    found = propagate(graph_of(9, chain(9)), params)
    assert found.truncated
    assert sorted(levels_of(found)) == [1, 2, 3, 4]
    assert levels_of(found)[4] == {frozenset(range(9))}
    assert not propagate(graph_of(3, chain(3)), params).truncated


@pytest.mark.parametrize("most", [1, 2, 3, 12])
@pytest.mark.parametrize("name", {**CONNECTED, **DISCONNECTED})
def test_apart_the_whole_is_the_one_row_of_the_top_level_and_alters_no_other(graph_of, name: str, most: int):
    graph = graph_of(*{**CONNECTED, **DISCONNECTED}[name])
    apart, last = (
        propagate(graph, HierarchyParams(max_constellations=4096, max_levels=most, whole_apart=a))
        for a in (True, False)
    )
    top = apart.levels[apart.levels[:, 0] == most + 1]
    assert len(top) == 1
    assert apart.members[top[0, 1]].all()
    assert apart.levels[:, 0].max() == most + 1
    assert apart.truncated == last.truncated
    whole = frozenset(range(graph.count))
    below, paper = ({n: s - {whole} for n, s in levels_of(f).items() if s != {whole}} for f in (apart, last))
    assert below == paper


def test_apart_the_vertices_of_the_top_level_memorise_the_wholes_and_nothing_else():
    model = learnt()
    assert model.params.hierarchy.whole_apart
    top = model.params.hierarchy.max_levels + 1
    assert model.ensemble.vertex_levels.max() == top
    for hierarchy in model.ensemble.hierarchies:
        above = np.array([level == top for level, _ in hierarchy.vertices])
        memories = hierarchy.prototypes.toarray()[above].any(axis=0)
        assert np.flatnonzero(memories).tolist() == sorted(model.novelty_scale.wholes.tolist())


@pytest.mark.parametrize("preset", PRESETS)
def test_the_levels_of_the_vertices_are_those_of_their_motifs(preset: str):
    ensemble = learnt(preset).ensemble
    first = 0
    for hierarchy in ensemble.hierarchies:
        for v, (level, _) in enumerate(hierarchy.vertices):
            assert ensemble.vertex_levels[first + v] == level
        first += len(hierarchy.vertices)
    assert first == len(ensemble.vertex_levels)


def test_a_motif_is_its_level_and_the_multiset_of_its_words(graph_of):
    found = propagate(graph_of(3, [(0, 1), (0, 2), (1, 2)]), wide(False))
    motifs = found.motifs(np.array([7, 2, 7]))
    assert motifs[:3] == [(1, (7,)), (1, (2,)), (1, (7,))]
    assert sorted(m for m in motifs if m[0] == 2) == [(2, (2, 7)), (2, (2, 7)), (2, (7, 7))]
    assert motifs[-1] == (3, (2, 7, 7))


def test_perception_describes_single_segments_first():
    for seen_object in perceived():
        count = seen_object.graph.count
        assert np.array_equal(seen_object.constellations.members[:count], np.eye(count, dtype=bool))
        assert seen_object.segment_descriptors.shape[0] == count


@pytest.mark.parametrize("preset", PRESETS)
def test_the_mean_over_a_vertex_is_that_over_its_prototypes(preset: str):
    ensemble = learnt(preset).ensemble
    kernel = np.random.default_rng(0).random(len(ensemble.prototypes))
    means = kernel @ ensemble.mean_over_vertex
    members = [row for h in ensemble.hierarchies for row in h.prototypes.toarray().astype(bool)]
    assert ensemble.vertex_count == len(members)
    assert np.allclose(means, [kernel[row].mean() for row in members])
