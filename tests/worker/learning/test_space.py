"""The topological space against scipy's trees and shortest paths."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from joblib import parallel_config
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import minimum_spanning_tree, shortest_path
from scipy.spatial.distance import jensenshannon

from service.engine.divergence import sparse_jsd
from service.engine.space import TopologicalSpace
from tests.learnt import learnt
from worker.learning.space import build_space

LN2 = np.log(2)


def sparse(seed: int, size: int, dimensions: int = 60, fill: float = 0.3) -> csr_array:
    rng = np.random.default_rng(seed)
    rows = rng.random((size, dimensions)) * (rng.random((size, dimensions)) < fill)
    return csr_array(rows.astype(np.float32))


def all_distances(stimuli: csr_array) -> NDArray[np.float64]:
    """The complete JSD graph; a vector of zeros is ln 2 from all that are not, and 0 from those that are."""
    rows = stimuli.toarray().astype(np.float64)
    empty = rows.sum(axis=1) == 0
    out = np.zeros((len(rows), len(rows)))
    for i in range(len(rows)):
        for j in range(i):
            if empty[i] or empty[j]:
                out[i, j] = out[j, i] = 0.0 if empty[i] and empty[j] else LN2
            else:
                out[i, j] = out[j, i] = jensenshannon(rows[i], rows[j]) ** 2
    return out


def exact_distances(rows: csr_array) -> NDArray[np.float64]:
    """Every distance of every two vectors, by the function that the tree uses."""
    size, total = rows.shape[0], np.array([r.astype(np.float64).sum() for r in np.split(rows.data, rows.indptr[1:-1])])
    total = np.where(total > 0, total, 1.0)
    distances = np.zeros((size, size))
    for i in range(size):
        p = rows[[i]].toarray().ravel() / total[i]
        for j in range(size):
            start, stop = int(rows.indptr[j]), int(rows.indptr[j + 1])
            distances[i, j] = sparse_jsd(p, bool(p.any()), rows.indices, rows.data, start, stop, total[j])
    return distances


def kruskal(distances: NDArray[np.float64]) -> list[tuple[int, int]]:
    """The tree's edges, taken in the order of (distance, smaller vertex, larger vertex)."""
    size = len(distances)
    component = list(range(size))
    tree = []
    for _, a, b in sorted((distances[i, j], i, j) for j in range(size) for i in range(j)):
        if component[a] != component[b]:
            tree.append((a, b))
            old, new = component[b], component[a]
            component = [new if c == old else c for c in component]
    return sorted(tree)


def check_heat(space: TopologicalSpace) -> None:
    size = len(space.geodesic_sum)
    graph = csr_array((np.ones(size - 1), space.edges.T), shape=(size, size))
    hops = shortest_path(graph, directed=False, unweighted=True)
    assert np.array_equal(space.geodesic_sum, hops.sum(axis=1))
    assert np.allclose(space.vertex_heat, hops.mean(axis=1))


@pytest.mark.parametrize(("seed", "size"), [(0, 2), (1, 3), (2, 10), (3, 60), (4, 150)])
def test_the_tree_is_scipys_and_its_heats_are_the_mean_shortest_paths(seed: int, size: int):
    stimuli = sparse(seed, size)
    space, distances = build_space(stimuli), all_distances(stimuli)
    theirs = minimum_spanning_tree(distances).tocoo()
    assert sorted(map(sorted, np.stack([theirs.row, theirs.col], axis=1).tolist())) == space.edges.tolist()
    assert space.distance.sum() == pytest.approx(theirs.data.sum(), rel=1e-9)
    assert np.allclose(space.distance, distances[tuple(space.edges.T)], atol=1e-9)
    check_heat(space)


@pytest.mark.parametrize("seed", range(4))
def test_the_tree_is_the_one_that_kruskal_builds(seed: int):
    stimuli = sparse(seed, 25)
    assert list(map(tuple, build_space(stimuli).edges.tolist())) == kruskal(all_distances(stimuli))


@pytest.mark.parametrize("order", [list(range(12)), list(range(11, -1, -1)), [3, 7, 1, 0, 11, 5, 2, 9, 4, 10, 8, 6]])
def test_ties_are_broken_by_index(order: list[int]):
    """One-hot vectors: those of one kind are 0 apart, those of two kinds exactly ln 2."""
    kinds = np.array([0, 0, 0, 1, 1, 2, 2, 2, 3, 4, 4, 4])[order]
    stimuli = csr_array(np.eye(5, dtype=np.float32)[kinds])
    space = build_space(stimuli)
    distances = np.where(kinds[:, None] == kinds, 0.0, LN2)
    assert list(map(tuple, space.edges.tolist())) == kruskal(distances)
    assert np.array_equal(space.distance, distances[tuple(space.edges.T)])
    check_heat(space)


@pytest.mark.parametrize("seed", range(12))
def test_ties_are_broken_by_index_wherever_the_tree_grows(seed: int):
    """Vectors of two equal entries: those that share both are 0 apart, those that share one all equally far."""
    rng = np.random.default_rng(seed)
    pairs = np.array([rng.choice(6, 2, replace=False) for _ in range(14)])
    rows = np.zeros((14, 6), np.float32)
    np.put_along_axis(rows, pairs, 1.0, axis=1)
    assert list(map(tuple, build_space(csr_array(rows)).edges.tolist())) == kruskal(2 - rows @ rows.T)


def test_duplicates_of_soft_vectors_are_no_distance_apart():
    rows = sparse(0, 6, fill=0.9).toarray()
    space = build_space(csr_array(np.concatenate([rows, rows, 3 * rows])))
    assert np.sort(space.distance)[:12].max() < 1e-12
    assert np.sort(space.distance)[12:].min() > 1e-4
    check_heat(space)


def test_vectors_of_zeros_have_their_place():
    rows = sparse(1, 8).toarray()
    rows[[2, 5, 6]] = 0
    space = build_space(csr_array(rows))
    assert list(map(tuple, space.edges.tolist())) == kruskal(all_distances(csr_array(rows)))
    assert sorted(space.distance)[0] == 0
    assert space.distance.max() == LN2
    nothing = build_space(csr_array((4, 10), dtype=np.float32))
    assert nothing.edges.tolist() == [[0, 1], [0, 2], [0, 3]]
    assert not nothing.distance.any()


def test_edges_stand_in_lexicographic_order_the_smaller_vertex_first():
    edges = build_space(sparse(5, 80)).edges
    assert (edges[:, 0] < edges[:, 1]).all()
    assert edges.tolist() == sorted(edges.tolist())


def test_scaling_a_stimuli_vector_changes_nothing():
    rows = sparse(6, 20).toarray()
    a, b = build_space(csr_array(rows)), build_space(csr_array(rows * np.float32(4)))
    assert np.array_equal(a.edges, b.edges)
    assert np.array_equal(a.distance, b.distance)


def test_the_input_is_left_alone_and_may_be_unsorted():
    stimuli = sparse(7, 20)
    flipped = csr_array((stimuli.data.copy(), stimuli.indices.copy(), stimuli.indptr.copy()), shape=stimuli.shape)
    for start, stop in zip(stimuli.indptr[:-1], stimuli.indptr[1:], strict=True):
        flipped.indices[start:stop] = flipped.indices[start:stop][::-1]
        flipped.data[start:stop] = flipped.data[start:stop][::-1]
    before = flipped.indices.copy()
    assert np.array_equal(build_space(flipped).edges, build_space(stimuli).edges)
    assert np.array_equal(flipped.indices, before)


def test_shapes_of_trees_have_the_heats_that_can_be_counted():
    # A path: each vector shares one dimension with the next. A star: all share one dimension with the first.
    n = 7
    path = np.eye(n, n + 1) + np.eye(n, n + 1, 1)
    space = build_space(csr_array(path.astype(np.float32)))
    assert space.edges.tolist() == [[i, i + 1] for i in range(n - 1)]
    assert space.geodesic_sum.tolist() == [sum(abs(i - j) for j in range(n)) for i in range(n)]
    star = np.concatenate([np.ones((1, n)), np.eye(n)])
    space = build_space(csr_array(star.astype(np.float32)))
    assert space.edges.tolist() == [[0, i] for i in range(1, n + 1)]
    assert space.geodesic_sum.tolist() == [n] + [1 + 2 * (n - 1)] * n


@pytest.mark.parametrize("preset", ["default", "paper"])
def test_a_models_space_can_be_recomputed_from_its_stored_stimuli(preset: str):
    model = learnt(preset)
    distances = all_distances(model.stimuli)
    assert list(map(tuple, model.space.edges.tolist())) == kruskal(distances)
    assert np.allclose(model.space.distance, distances[tuple(model.space.edges.T)], atol=1e-12)
    check_heat(model.space)


def mixture(seed: int, size: int, dimensions: int = 200) -> csr_array:
    """Stimuli as objects of a few kinds have them: all dimensions filled, kinds of kinds, some twins, one of zeros."""
    rng = np.random.default_rng(seed)
    means = rng.gamma(0.5, size=(4, dimensions)) + 1e-3
    kinds = means[rng.integers(4, size=12)] * rng.gamma(20.0, size=(12, dimensions))
    rows = kinds[rng.integers(12, size=size)] * rng.gamma(200.0, size=(size, dimensions))
    rows[size // 2 : size // 2 + 3] = rows[:3]
    rows[size // 3] = 0
    return csr_array(rows.astype(np.float32))


@pytest.mark.parametrize("stimuli", [mixture(0, 220), mixture(1, 90), sparse(9, 120), sparse(10, 120, fill=0.02)])
def test_what_the_bounds_spare_changes_no_bit_of_the_tree(stimuli: csr_array):
    """The slow plain twin: the exact distance of every two vectors, and Kruskal's algorithm."""
    distances = exact_distances(stimuli)
    space = build_space(stimuli)
    assert list(map(tuple, space.edges.tolist())) == kruskal(distances)
    assert np.array_equal(space.distance, distances[tuple(space.edges.T)])


@pytest.mark.parametrize("stimuli", [mixture(2, 60), sparse(11, 40), sparse(12, 40, fill=0.05)])
def test_a_distance_is_the_same_from_either_end_and_none_from_itself(stimuli: csr_array):
    distances, true = exact_distances(stimuli), all_distances(stimuli)
    assert np.array_equal(distances, distances.T)
    assert not np.diag(distances).any()
    assert np.allclose(distances, true, rtol=1e-9, atol=1e-13)


@pytest.mark.parametrize("threads", [2, 5])
def test_the_tree_is_the_same_for_any_number_of_threads(threads: int):
    """Enough vectors for many shares, of which many are equal and many others as good as equal."""
    rng = np.random.default_rng(4)
    rows = mixture(3, 700).toarray()
    rows[300:400] = rows[rng.integers(300, size=100)]
    rows[400:500] = rows[rng.integers(300, size=100)] * (1 + 1e-6 * rng.standard_normal((100, rows.shape[1])))
    stimuli = csr_array(np.maximum(rows, 0).astype(np.float32))
    with parallel_config(backend="threading", n_jobs=1):
        alone = build_space(stimuli)
    with parallel_config(backend="threading", n_jobs=threads):
        shared = build_space(stimuli)
    assert np.array_equal(alone.edges, shared.edges)
    assert np.array_equal(alone.distance, shared.distance)
    distances = exact_distances(stimuli)
    assert list(map(tuple, alone.edges.tolist())) == kruskal(distances)
    assert np.array_equal(alone.distance, distances[tuple(alone.edges.T)])


def test_vectors_that_differ_by_rounding_are_told_apart_from_equal_ones():
    """Equal, proportional and next to equal vectors: the tree is that of all distances all the same."""
    base = mixture(5, 9).toarray()[:1]
    rows = np.concatenate([base, base, 3 * base, np.nextafter(base, np.float32(9)), base, 7 * base, 3 * base])
    stimuli = csr_array(rows.astype(np.float32))
    distances = exact_distances(stimuli)
    space = build_space(stimuli)
    assert list(map(tuple, space.edges.tolist())) == kruskal(distances)
    assert np.array_equal(space.distance, distances[tuple(space.edges.T)])


@pytest.mark.parametrize("scales", [[1e-44, 1.0], [1e-40, 1e-20, 1e30], [1e37, 1e-37]])
def test_vectors_may_be_of_any_size(scales: list[float]):
    """Down to where single precision cannot divide by their sums any more."""
    rng = np.random.default_rng(0)
    rows = rng.random((40, 12)) * rng.choice(scales, (40, 1))
    stimuli = csr_array(rows.astype(np.float32))
    distances = exact_distances(stimuli)
    space = build_space(stimuli)
    assert list(map(tuple, space.edges.tolist())) == kruskal(distances)
    assert np.array_equal(space.distance, distances[tuple(space.edges.T)])


def test_thousands_of_equal_vectors_cost_no_more_than_one():
    rows = np.repeat(sparse(13, 5, dimensions=50, fill=1.0).toarray(), 4000, axis=0)
    space = build_space(csr_array(rows))
    assert (space.distance == 0).sum() == 5 * 3999
    assert (np.bincount(space.edges.ravel()) >= 3999).sum() == 5


def test_the_matrix_of_all_distances_is_never_held():
    stimuli = sparse(8, 3000, dimensions=400, fill=0.02)
    build_space(stimuli[:10])
    tracemalloc.start()
    build_space(stimuli)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 3000**2  # bytes: an eighth of the full matrix
