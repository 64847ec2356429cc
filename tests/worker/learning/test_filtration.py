"""The filtration against GUDHI, and the rules for its grid and for degenerate outcomes."""

from __future__ import annotations

import gudhi
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, shortest_path

from service.engine.concepts import concepts_at
from service.engine.filtration import Filtration, annexations_over_time, barcode
from service.engine.params import FiltrationParams
from service.engine.space import TopologicalSpace
from tests.learnt import learnt
from worker.learning.concepts import Extraction, extract_concepts
from worker.learning.filtration import filtrate

PARAMS = FiltrationParams(max_steps=100, window=0)  # the paper's epsilon_max
WINDOWS = [0.01, 0.1, 0.25, 0.5]


def filtrated(space: TopologicalSpace, params: FiltrationParams) -> Extraction:
    return extract_concepts(filtrate(space, params))


def space_of(edges: list[tuple[int, int]]) -> TopologicalSpace:
    """The space whose tree has these edges; the JSD along them plays no part in the filtration."""
    joined = np.array(sorted((min(e), max(e)) for e in edges), dtype=np.int64)
    size = len(joined) + 1
    graph = csr_array((np.ones(size - 1), joined.T), shape=(size, size))
    sums = shortest_path(graph, directed=False, unweighted=True).sum(axis=1)
    return TopologicalSpace(joined, np.full(size - 1, 0.1), sums.astype(np.int64))


def random_tree(seed: int, size: int, spread: float = 1.0) -> TopologicalSpace:
    """Each vertex joins an earlier one; a small `spread` makes it a long tree, a large one a bush."""
    rng = np.random.default_rng(seed)
    name = rng.permutation(size)
    edges = [(int(name[i]), int(name[rng.integers(max(0, int(i - spread * size)), i)])) for i in range(1, size)]
    return space_of(edges)


def path(n: int) -> TopologicalSpace:
    return space_of([(i, i + 1) for i in range(n - 1)])


TREES = {
    "a small bush": random_tree(0, 12),
    "a bush": random_tree(1, 200),
    "a long tree": random_tree(2, 200, 0.03),
    "a longer tree": random_tree(3, 700, 0.005),
    "a path": path(50),
    "an odd path": path(51),
    "a caterpillar": space_of([(i, i + 1) for i in range(19)] + [(i, i + 20) for i in range(20)]),
    "three": path(3),
    "four": path(4),
}
trees = pytest.mark.parametrize("tree", TREES)


def edge_distances(space: TopologicalSpace) -> NDArray[np.float64]:
    """As the method says: vertex heats scaled to [0, 1] and inverted, then averaged per edge."""
    heat = space.vertex_heat
    inverted = 1 - (heat - heat.min()) / np.ptp(heat)
    return inverted[space.edges].mean(axis=1)


@trees
def test_edges_are_as_far_as_their_heat(tree: str):
    space = TREES[tree]
    if np.ptp(space.vertex_heat) > 0:
        assert np.allclose(filtrated(space, PARAMS).filtration.distance, edge_distances(space), atol=1e-12)


@trees
def test_bars_are_those_of_gudhi_to_the_last_bit(tree: str):
    space, filtration = TREES[tree], filtrated(TREES[tree], PARAMS).filtration
    complex_ = gudhi.SimplexTree()
    for v in range(len(space.geodesic_sum)):
        complex_.insert([v], 0.0)
    for edge, distance in zip(space.edges.tolist(), filtration.distance.tolist(), strict=True):
        complex_.insert(edge, distance)
    complex_.compute_persistence(min_persistence=-1)
    theirs = complex_.persistence_intervals_in_dimension(0)
    assert np.array_equal(np.sort(theirs[:, 1]), np.append(np.sort(filtration.distance), np.inf))
    assert not theirs[:, 0].any()


@trees
def test_the_barcode_is_the_annexation_times_and_one_bar_that_never_ends(tree: str):
    filtration = filtrated(TREES[tree], PARAMS).filtration
    bars = barcode(filtration)
    assert not bars[:, 0].any()
    assert np.array_equal(bars[:-1, 1], np.sort(filtration.time))
    assert bars[-1, 1] == np.inf


@pytest.mark.parametrize("max_steps", [1, 7, 100, 10_000])
@trees
def test_times_lie_on_a_grid_that_is_no_finer_than_allowed(tree: str, max_steps: int):
    space = TREES[tree]
    filtration = filtrated(space, FiltrationParams(max_steps=max_steps)).filtration
    time, distance = filtration.time, filtration.distance
    span = np.ptp(distance)
    if span == 0:
        assert not time.any()
        return
    assert time.min() == 0
    assert time.max() == 1
    exact = (distance - distance.min()) / span
    step = max(distance.min() / span, 1 / max_steps)
    steps = time / step
    on_grid = np.isclose(steps, np.rint(steps), atol=1e-6) | (time == 1)
    assert on_grid.all()
    assert (time >= exact - 1e-12).all()  # rounded up,
    assert (time - exact < step + 1e-12).all()  # by less than a step
    assert len(np.unique(time)) <= max_steps + 1
    assert (np.diff(time[np.argsort(distance, kind="stable")]) >= 0).all()


@trees
def test_annexations_are_ordered_by_distance_and_edge(tree: str):
    space, filtration = TREES[tree], filtrated(TREES[tree], PARAMS).filtration
    expected = sorted(range(len(space.edges)), key=lambda e: (filtration.distance[e], *space.edges[e]))
    assert np.argsort(filtration.order).tolist() == expected


def annex(space: TopologicalSpace, order: NDArray[np.int64]) -> list[tuple[int, int]]:
    """Who dies and who sustains, with plain sets."""
    component = {v: {v} for v in range(len(space.geodesic_sum))}
    representative = {v: v for v in component}
    pairs = {}
    for e in np.argsort(order):
        a, b = (representative[v] for v in space.edges[e].tolist())
        sustains = min((a, b), key=lambda r: (-len(component[r]), r))
        dies = b if sustains == a else a
        component[sustains] |= component.pop(dies)
        for v in component[sustains]:
            representative[v] = sustains
        pairs[int(e)] = (dies, sustains)
    return [pairs[e] for e in range(len(pairs))]


@trees
def test_the_larger_component_annexes_the_smaller(tree: str):
    space, filtration = TREES[tree], filtrated(TREES[tree], PARAMS).filtration
    assert list(zip(filtration.annexed, filtration.annexing, strict=True)) == annex(space, filtration.order)


def components(size: int, edges: NDArray[np.int64]) -> NDArray[np.int64]:
    graph = csr_array((np.ones(len(edges)), edges.T), shape=(size, size))
    labels = connected_components(graph, directed=False)[1]
    return np.unique(labels, return_index=True)[1][labels]  # named after the first vertex


@trees
def test_the_annexation_graph_is_a_tree_with_the_same_components_at_any_time(tree: str):
    space, filtration = TREES[tree], filtrated(TREES[tree], PARAMS).filtration
    size = len(space.geodesic_sum)
    graph = np.stack([filtration.annexed, filtration.annexing], axis=1)
    assert len(np.unique(filtration.annexed)) == size - 1  # each but one dies once
    for time in np.unique(filtration.time)[:: max(1, len(np.unique(filtration.time)) // 12)]:
        here = filtration.time <= time
        assert np.array_equal(components(size, graph[here]), components(size, space.edges[here]))
    assert len(np.unique(components(size, graph))) == 1


def mode(filtration: Filtration) -> float:
    """The earliest of the times that saw most annexations."""
    times = filtration.time.tolist()
    return min(set(times), key=lambda t: (-times.count(t), t))


@trees
def test_epsilon_max_is_the_earliest_time_of_most_annexations(tree: str):
    filtration, notes = filtrated(TREES[tree], PARAMS)
    if not notes:
        assert filtration.epsilon_max == mode(filtration)
    assert filtration.epsilon_max in filtration.time


def test_of_equally_many_annexations_the_earliest_time_is_taken():
    filtration, notes = filtrated(path(9), FiltrationParams(max_steps=10_000, window=0))
    times, counts = annexations_over_time(filtration)
    assert (counts == counts[0]).sum() > 1
    assert filtration.epsilon_max == times[0]
    assert notes == ()


def in_stretch(filtration: Filtration, middle: float, window: float) -> int:
    """Annexations at most half a window before or after a time; those on an end of the stretch count."""
    return sum(abs(time - middle) <= window / 2 + 1e-9 for time in filtration.time.tolist())


@pytest.mark.parametrize("window", WINDOWS)
@trees
def test_epsilon_max_is_the_middle_of_the_stretch_of_most_annexations(tree: str, window: float):
    filtration = filtrate(TREES[tree], FiltrationParams(window=window))
    if np.ptp(filtration.distance) == 0:
        assert filtration.epsilon_max == filtration.time[0] == 0
        return
    # Of a hundred and one stretches, from that at the very beginning to that at the very end of time.
    middles = [window / 2 + step * (1 - window) / 100 for step in range(101)]
    counts = [in_stretch(filtration, middle, window) for middle in middles]
    assert filtration.epsilon_max == pytest.approx(middles[counts.index(max(counts))], abs=1e-12)
    assert window / 2 <= filtration.epsilon_max <= 1 - window / 2


@pytest.mark.parametrize("window", WINDOWS)
def test_the_stretch_of_most_annexations_sees_no_fewer_than_the_busiest_moment(window: float):
    """Wherever the moments of annexations are, a stretch can be laid over them."""
    for tree in ("a bush", "a long tree", "a longer tree"):
        paper = filtrate(TREES[tree], FiltrationParams(window=0))
        stretched = filtrate(TREES[tree], FiltrationParams(window=window))
        assert np.array_equal(paper.time, stretched.time)
        most = (paper.time == paper.epsilon_max).sum()
        assert in_stretch(stretched, stretched.epsilon_max, window) >= most


@pytest.mark.parametrize("window", WINDOWS)
@trees
def test_there_are_concepts_at_epsilon_max_and_not_one_of_all_if_it_can_be_helped(tree: str, window: float):
    space = TREES[tree]
    filtration, notes = filtrated(space, FiltrationParams(window=window))
    sizes = concepts_at(filtration).sizes
    assert len(sizes) >= 1
    assert len(sizes) >= 2 or int(sizes[0]) < len(space.geodesic_sum) or bool(notes) or not filtration.time.any()


@trees
def test_annexations_over_time_count_every_edge_once(tree: str):
    filtration = filtrated(TREES[tree], PARAMS).filtration
    times, counts = annexations_over_time(filtration)
    assert counts.sum() == len(filtration.time)
    assert (np.diff(times) > 0).all()
    assert [int((filtration.time == t).sum()) for t in times] == counts.tolist()


@pytest.mark.parametrize("window", [0, *WINDOWS])
@pytest.mark.parametrize(
    "space", [path(2), space_of([(0, i) for i in range(1, 9)]), space_of([(i, 4) for i in range(4)])]
)
def test_where_all_distances_are_equal_there_is_one_time_and_one_concept(space: TopologicalSpace, window: float):
    filtration, notes = filtrated(space, FiltrationParams(window=window))
    assert not filtration.time.any()
    assert filtration.epsilon_max == 0
    concepts = concepts_at(filtration)
    assert concepts.sizes.tolist() == [len(space.geodesic_sum)]
    assert np.isfinite(filtration.distance).all()
    assert notes == () or "one concept" in notes[0] or "two concepts" in notes[0]


def test_an_end_of_the_spectrum_with_one_concept_is_left_for_two_and_said_aloud():
    moved = 0
    for seed in range(60):
        filtration, notes = filtrated(random_tree(seed, 14, 0.2), PARAMS)
        most = mode(filtration)
        assert bool(notes) == (concepts_at(filtration, most).sizes.tolist() == [14])
        if notes and "instead" in notes[0]:
            moved += 1
            assert f"{most:g}" in notes[0]
            assert len(concepts_at(filtration).sizes) >= 2
            assert filtration.epsilon_max < most
        else:
            assert filtration.epsilon_max == most
    assert moved > 0


@pytest.mark.parametrize("window", [0, *WINDOWS])
def test_the_names_of_the_vertices_do_not_decide_the_times(window: float):
    space = TREES["a long tree"]
    renamed = np.random.default_rng(0).permutation(len(space.geodesic_sum))
    other = space_of([tuple(renamed[e].tolist()) for e in space.edges])
    a, b = (filtrated(s, FiltrationParams(window=window)).filtration for s in (space, other))
    assert np.array_equal(np.sort(a.time), np.sort(b.time))
    assert a.epsilon_max == b.epsilon_max


@pytest.mark.parametrize("preset", ["default", "paper"])
def test_a_models_filtration_follows_from_its_space(preset: str):
    model = learnt(preset)
    filtration, notes = filtrated(model.space, model.params.filtration)
    assert notes == model.notes
    assert np.array_equal(filtration.time, model.filtration.time)
    assert filtration.epsilon_max == model.filtration.epsilon_max
    assert np.allclose(filtration.distance, edge_distances(model.space), atol=1e-12)
