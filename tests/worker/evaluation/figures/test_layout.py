"""Where the vertices of trees are drawn."""

from __future__ import annotations

import time

import numpy as np
import pytest
from numpy.typing import NDArray

from worker.evaluation.figures.layout import RootedTree, angles, depths, inner, on_rings, rooted, unfolded


def path(size: int) -> RootedTree:
    return rooted(np.stack([np.arange(size - 1), np.arange(1, size)], axis=1), size, size // 2)


def star(size: int) -> RootedTree:
    return rooted(np.stack([np.zeros(size - 1, np.int64), np.arange(1, size)], axis=1), size, 0)


def random_tree(size: int, seed: int = 0, reach: int = 8) -> RootedTree:
    rng = np.random.default_rng(seed)
    edges = [[max(0, child - 1 - int(rng.integers(reach))), child] for child in range(1, size)]
    return rooted(np.array(edges), size, 0)


def steps(tree: RootedTree) -> NDArray[np.int64]:
    """Geodesic distances, by walking up to the first common ancestor."""
    size = len(tree.order)
    lines = []
    for vertex in range(size):
        line = [vertex]
        while tree.parent[line[-1]] >= 0:
            line.append(int(tree.parent[line[-1]]))
        lines.append(line)
    table = np.zeros((size, size), np.int64)
    for a in range(size):
        for b in range(size):
            common = next(v for v in lines[a] if v in set(lines[b]))
            table[a, b] = lines[a].index(common) + lines[b].index(common)
    return table


def distances(places: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.linalg.norm(places[:, None] - places, axis=2)


@pytest.mark.parametrize("size", [1, 2, 3, 30])
def test_a_path_unfolds_to_a_straight_line_of_unit_steps(size: int) -> None:
    tree = path(size)
    np.testing.assert_allclose(distances(unfolded(tree)), steps(tree), atol=0.05)


def test_unfolding_brings_a_tree_nearer_to_its_distances_than_its_directions_alone() -> None:
    tree = random_tree(80)
    wanted = steps(tree)
    far = wanted > 0

    def stress(places: NDArray[np.float64]) -> float:
        return float((((distances(places) - wanted)[far] / wanted[far]) ** 2).sum())

    assert stress(unfolded(tree)) < 0.5 * stress(on_rings(tree))


def test_one_tree_is_drawn_alike_each_time() -> None:
    tree = random_tree(50)
    np.testing.assert_array_equal(unfolded(tree), unfolded(tree))


def test_a_tree_stands_upright() -> None:
    across, up = np.ptp(unfolded(path(20)), axis=0)
    assert up > 10 * across


def test_leaves_divide_the_whole_angle_evenly() -> None:
    tree = random_tree(60)
    leaves = np.setdiff1d(np.arange(60), tree.parent)
    leaves = leaves[leaves != tree.order[0]]
    between = np.diff(np.sort(angles(tree)[leaves]))
    np.testing.assert_allclose(between, 2 * np.pi / len(leaves))


def test_a_vertex_lies_on_the_ring_of_its_depth() -> None:
    tree = random_tree(60)
    radius = np.linalg.norm(on_rings(tree), axis=1)
    for depth in np.unique(depths(tree)):
        on_ring = radius[depths(tree) == depth]
        np.testing.assert_allclose(on_ring, on_ring[0])
    assert radius[tree.order[0]] == 0
    assert (np.diff([radius[depths(tree) == depth][0] for depth in np.unique(depths(tree))]) > 0).all()


@pytest.mark.parametrize("tree", [path(9), star(9), random_tree(90)], ids=["path", "star", "random"])
@pytest.mark.parametrize("most", [1, 5, 40, 1000])
def test_what_is_kept_of_a_tree_hangs_together(tree: RootedTree, most: int) -> None:
    kept = set(inner(tree, most).tolist())
    assert len(kept) == min(most, len(tree.order))
    assert tree.order[0] in kept
    assert all(tree.parent[vertex] in kept for vertex in kept if vertex != tree.order[0])


def test_a_few_thousand_vertices_are_laid_out_in_seconds() -> None:
    unfolded(random_tree(10))  # compiles, the first time of an installation
    began = time.process_time()
    places = unfolded(random_tree(2500))
    assert time.process_time() - began < 15
    assert np.isfinite(places).all()
