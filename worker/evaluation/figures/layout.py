"""Where the vertices of a tree are drawn; the same tree is always drawn alike."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

EPOCHS, LAST_STEP = 30, 0.1  # of the unfolding, as in Zheng et al. 2018


class RootedTree(NamedTuple):
    """A tree seen from one of its vertices.

    Attributes:
        order: (N,) int64: vertices from the root outwards.
        parent: (N,) int64: of each vertex; -1 of the root.
    """

    order: NDArray[np.int64]
    parent: NDArray[np.int64]


def rooted(edges: NDArray[np.int64], size: int, root: int) -> RootedTree:
    """Roots a tree.

    Args:
        edges: (N - 1, 2); those of one parent give its children their order.
        size: N.
        root: a vertex.
    """
    near: list[list[int]] = [[] for _ in range(size)]
    for a, b in edges.tolist():
        near[a].append(b)
        near[b].append(a)
    order, parent = [root], np.full(size, -1, np.int64)
    for vertex in order:
        for other in near[vertex]:
            if other != parent[vertex]:
                parent[other] = vertex
                order.append(other)
    return RootedTree(np.array(order, np.int64), parent)


def inner(tree: RootedTree, most: int) -> NDArray[np.int64]:
    """The vertices with the largest subtrees, at most so many, ascending.

    A vertex has a larger subtree than its children, so what is kept hangs together.
    """
    subtree = np.ones(len(tree.order), np.int64)
    for vertex in tree.order[:0:-1]:
        subtree[tree.parent[vertex]] += subtree[vertex]
    return np.sort(np.argsort(-subtree, kind="stable")[:most])


def angles(tree: RootedTree) -> NDArray[np.float64]:
    """The direction of each vertex (N,), radians: the middle of its subtree's share of its parent's angle.

    The whole angle is the root's; children share their parent's in proportion to their leaves.
    """
    leaves = np.zeros(len(tree.order), np.int64)
    for vertex in tree.order[::-1]:
        leaves[vertex] = max(leaves[vertex], 1)
        if tree.parent[vertex] >= 0:
            leaves[tree.parent[vertex]] += leaves[vertex]
    width = 2 * np.pi * leaves / leaves[tree.order[0]]
    taken = np.zeros(len(tree.order))  # where the next child of each vertex begins
    direction = np.zeros(len(tree.order))
    for vertex in tree.order[1:]:
        begin = taken[tree.parent[vertex]]
        taken[tree.parent[vertex]] += width[vertex]
        taken[vertex], direction[vertex] = begin, begin + width[vertex] / 2
    return direction


def depths(tree: RootedTree) -> NDArray[np.int64]:
    """Steps from the root to each vertex (N,)."""
    depth = np.zeros(len(tree.order), np.int64)
    for vertex in tree.order[1:]:
        depth[vertex] = depth[tree.parent[vertex]] + 1
    return depth


def on_rings(tree: RootedTree) -> NDArray[np.float64]:
    """Places of the vertices (N, 2) on rings about the root, one a step: for shallow trees.

    The first ring is three steps from the root, as room is scarcest there.
    """
    direction, depth = angles(tree), depths(tree)
    radius = np.where(depth > 0, depth + 2, 0)
    return np.asarray(radius[:, None] * np.stack([np.cos(direction), np.sin(direction)], axis=1))


def unfolded(tree: RootedTree) -> NDArray[np.float64]:
    """Places of the vertices (N, 2), as far apart as they are steps apart in the tree, as well as a plane allows.

    Begins with edges of length 1 in the directions of `angles`, which cross nowhere, and lessens the stress by
    gradients of one pair at a time (Zheng, Pawar, Goodman 2018). Takes N^2 time and memory.
    """
    direction = angles(tree)
    places = np.zeros((len(tree.order), 2))
    for vertex in tree.order[1:]:
        step = np.array([np.cos(direction[vertex]), np.sin(direction[vertex])])
        places[vertex] = places[tree.parent[vertex]] + step
    steps = _steps_between(tree)
    farthest = float(steps.max(initial=1))
    rates = np.geomspace(farthest**2, LAST_STEP, EPOCHS)
    _lessen_stress(places, steps, np.random.default_rng(0).permutation(len(places)), rates)
    return _upright(places)


def _steps_between(tree: RootedTree) -> NDArray[np.int16]:
    """Geodesic distances (N, N): one more than the parent's to all vertices that are nearer to the root."""
    steps = np.zeros((len(tree.order), len(tree.order)), np.int16)
    for k, vertex in enumerate(tree.order[1:], 1):
        before = tree.order[:k]
        steps[vertex, before] = steps[tree.parent[vertex], before] + 1
        steps[before, vertex] = steps[vertex, before]
    return steps


@njit(cache=True, nogil=True)
def _lessen_stress(
    places: NDArray[np.float64], steps: NDArray[np.int16], order: NDArray[np.int64], rates: NDArray[np.float64]
) -> None:
    """Moves each pair towards its distance; pairs far apart weigh less, and the moves become smaller."""
    for rate in rates:
        for a in range(len(order)):
            for b in range(a):
                i, j = order[a], order[b]
                wanted = float(steps[i, j])
                dx, dy = places[i, 0] - places[j, 0], places[i, 1] - places[j, 1]
                apart = max(np.sqrt(dx * dx + dy * dy), 1e-9)
                share = min(rate / (wanted * wanted), 1.0) * (apart - wanted) / (2 * apart)
                places[i, 0] -= share * dx
                places[i, 1] -= share * dy
                places[j, 0] += share * dx
                places[j, 1] += share * dy


def _upright(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """The places about their mean, turned so that they reach farthest upwards and downwards."""
    centred = places - places.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    turned = centred @ axes
    farthest = np.abs(turned).argmax(axis=0)
    return np.asarray(turned * np.where(turned[farthest, [0, 1]] < 0, -1, 1))
