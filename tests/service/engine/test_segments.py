"""Super patches: the faces that a person would name, and which of them are adjacent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from sklearn.metrics import adjusted_rand_score

from service.engine.neighbours import neighbourhood
from service.engine.params import SegmentParams
from service.engine.segments import SegmentGraph, _borders, _merge, merge_patches
from tests.service.engine.seen import PARAMS, Seen, seen
from tests.shapes import ball, box, can, corner_view, cube, lid_view, look, stack
from worker.simulation.camera import View
from worker.simulation.compositions import Composition

SEEDS = 50
EVERY = list(range(SEEDS))
ADJACENT = [[0, 1], [0, 2], [1, 2]]  # of a cube's three faces


def right(solid: Composition, views: list[View], noise: str, edges: list[list[int]]) -> list[bool]:
    """For each view, whether the segments are as many as `edges` joins, adjacent as it says, and the true faces."""
    results = []
    for seed, view in enumerate(views):
        here = seen(solid, view, noise, seed)
        as_told = here.graph.count == 1 + max(b for _, b in edges) and here.graph.edges.tolist() == edges
        results.append(as_told and adjusted_rand_score(here.truth.faces, here.graph.labels) > 0.8)
    return results


more = pytest.mark.slow  # further sizes and distances of the same law


@pytest.mark.parametrize(
    ("edge", "distance"), [(0.08, 0.9), (0.15, 0.9), *(pytest.param(*c, marks=more) for c in [(0.08, 0.6), (0.2, 1.4)])]
)
def test_a_cube_seen_at_a_corner_always_has_three_segments_all_adjacent(edge: float, distance: float):
    views = [corner_view(seed, distance) for seed in EVERY]
    assert all(right(cube(edge), views, "none", ADJACENT))


@pytest.mark.parametrize(
    ("edge", "distance"), [(0.08, 0.7), (0.15, 0.9), *(pytest.param(*c, marks=more) for c in [(0.08, 1.2), (0.2, 1.4)])]
)
def test_a_cube_seen_with_noise_nearly_always_has_three_segments_all_adjacent(edge: float, distance: float):
    views = [corner_view(seed, distance) for seed in EVERY]
    assert sum(right(cube(edge), views, "kinect", ADJACENT)) >= 0.9 * SEEDS


@pytest.mark.parametrize(
    ("radius", "height", "distance"),
    [(0.035, 0.12, 0.7), (0.035, 0.18, 0.9), pytest.param(0.08, 0.1, 0.9, marks=more)],
)
def test_a_can_always_has_two_segments(radius: float, height: float, distance: float):
    views = [lid_view(seed, distance) for seed in EVERY]
    assert all(right(can(radius, height), views, "none", [[0, 1]]))


@pytest.mark.parametrize(
    ("radius", "height", "distance"),
    [(0.04, 0.1, 0.9), (0.035, 0.18, 0.9), pytest.param(0.08, 0.1, 0.9, marks=more)],
)
def test_a_can_seen_with_noise_nearly_always_has_two_segments(radius: float, height: float, distance: float):
    views = [lid_view(seed, distance) for seed in EVERY]
    assert sum(right(can(radius, height), views, "kinect", [[0, 1]])) >= 0.9 * SEEDS


@pytest.mark.parametrize("noise", ["none", "kinect"])
def test_a_ball_is_one_segment_and_so_is_a_face_seen_alone(noise: str):
    for distance in (0.7, 1.0):
        assert seen(ball(0.07), look(20, 30, distance), noise).graph.count == 1
        assert seen(cube(0.15), look(0, 0, distance), noise).graph.count == 1


def test_faces_that_do_not_touch_are_not_adjacent():
    apart = stack((cube(0.1), (0, -0.1, 0)), (cube(0.1), (0, 0.1, 0)))
    here = seen(apart, look(0, 45, 1.0))
    front, top = ([int(np.median(here.graph.labels[here.truth.faces == 6 * c + f])) for c in (0, 1)] for f in (1, 5))
    assert here.graph.count == 4
    assert sorted(here.graph.edges.tolist()) == sorted(sorted([front[c], top[c]]) for c in (0, 1))


COMPOSITIONS = {
    "a can on a box": (stack((box(0.2, 0.2, 0.1), (0, 0, 0)), (can(0.05, 0.12), (0, 0, 0.11))), look(30, 35, 1.0)),
    "a ball on a slab": (stack((box(0.2, 0.2, 0.08), (0, 0, 0)), (ball(0.05), (0, 0, 0.07))), look(30, 40, 0.9)),
    "two boxes": (stack((cube(0.1), (0, -0.1, 0)), (box(0.1, 0.12, 0.14), (0, 0.1, 0))), look(25, 35, 0.9)),
    "steps": (stack((box(0.2, 0.2, 0.1), (0, 0, 0)), (box(0.1, 0.2, 0.1), (-0.05, 0, 0.1))), look(30, 35, 1.0)),
}


@pytest.mark.parametrize(("noise", "least"), [("none", 0.82), ("kinect", 0.75)])
@pytest.mark.parametrize("what", COMPOSITIONS)
def test_segments_of_compositions_are_their_true_faces(what: str, noise: str, least: float):
    here = seen(*COMPOSITIONS[what], noise)
    assert adjusted_rand_score(here.truth.faces, here.graph.labels) > least


@pytest.fixture(scope="module")
def steps() -> Seen:
    return seen(*COMPOSITIONS["steps"], "kinect")


def test_segments_are_numbered_by_size_and_share_the_surface(steps: Seen):
    graph = steps.graph
    counts = np.bincount(graph.labels)
    assert (np.diff(counts) <= 0).all()
    assert np.allclose(graph.share, counts / len(graph.labels))
    assert graph.share.sum() == pytest.approx(1)


def test_edges_join_each_pair_once_the_smaller_number_first(steps: Seen):
    edges = steps.graph.edges
    assert (edges[:, 0] < edges[:, 1]).all()
    assert np.array_equal(edges, np.unique(edges, axis=0))
    assert edges.max() < steps.graph.count


def test_segments_are_made_of_whole_patches(steps: Seen):
    for patch in range(steps.patches.count):
        assert len(np.unique(steps.graph.labels[steps.patches.labels == patch])) == 1


def merged(steps: Seen, **choices: float) -> SegmentGraph:
    return merge_patches(steps.patches, SegmentParams(**{**PARAMS.segments.model_dump(), **choices}))


@pytest.mark.parametrize("most", [1, 2, 3])
def test_more_segments_than_allowed_are_absorbed(steps: Seen, most: int):
    assert merged(steps, max_segments=most).count == most


def test_small_segments_are_absorbed(steps: Seen):
    assert merged(steps, angle=5, min_share=0).count > merged(steps, angle=5, min_share=0.05).count
    assert merged(steps, angle=5, min_share=0.05).share.min() >= 0.05


def test_a_larger_angle_merges_more_and_none_at_all_leaves_the_patches(steps: Seen):
    counts = [merged(steps, angle=angle, min_share=0, max_segments=62).count for angle in (8, 20, 60, 120)]
    assert counts == sorted(counts, reverse=True)
    assert counts[-1] == 1


def test_parts_that_nothing_joins_stay_apart():
    # A bar seen behind a post: its two halves are on one plane, with nothing between them.
    solid = stack((box(0.02, 0.4, 0.05), (-0.1, 0, 0)), (box(0.02, 0.08, 0.3), (0.1, 0, 0)))
    graph = seen(solid, look(0, 0, 1.2)).graph
    assert graph.count == 3
    assert len(graph.edges) == 0


def test_the_labels_of_patches_do_not_matter(steps: Seen):
    order = np.random.default_rng(0).permutation(steps.patches.count)
    renamed = merge_patches(replace(steps.patches, labels=order[steps.patches.labels]), PARAMS.segments)
    assert adjusted_rand_score(renamed.labels, steps.graph.labels) > 0.99


def plain_merge(slack, length, size, smooth: float, least: float, most: int) -> NDArray[np.int64]:
    """The rule of merging, word by word: every border is looked at again after every union."""
    slack, length, size = slack.copy(), length.copy(), size.copy()
    root = np.arange(len(size))

    def join(a: int, b: int) -> None:
        for table in (slack, length):
            table[a] += table[b]
            table[:, a] += table[:, b]
            table[b], table[:, b], table[a, a] = 0, 0, 0
        size[a] += size[b]
        size[b] = 0
        root[root == b] = a

    def bend(i: int, j: int) -> float:
        return slack[i, j] / length[i, j]

    while True:
        borders = [(bend(i, j), i, j) for i, j in np.argwhere(np.tril(length))]
        if not borders or max(borders)[0] < smooth:
            break
        _, b, a = max(borders)
        join(a, b)
    while True:
        alive = [i for i in np.argsort(size, kind="stable") if size[i] > 0]
        small = [i for i in alive if length[i].any() and (size[i] < least or len(alive) > most)]
        if small:
            b = small[0]
            a = max(np.flatnonzero(length[b]), key=lambda j: (bend(b, j), -j))
        elif len(alive) > most:
            a, b = np.argsort(-size, kind="stable")[[0, len(alive) - 1]]
        else:
            return root
        join(a, b)


@pytest.mark.parametrize("seed", range(20))
def test_patches_are_merged_by_the_rule(seed: int):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 40))
    length = np.triu(rng.integers(1, 30, (count, count)) * (rng.random((count, count)) < 0.15), 1).astype(float)
    slack = np.triu(rng.normal(-0.4, 0.3, (count, count)), 1) * length
    tables = slack + slack.T, length + length.T
    rule = rng.integers(5, 40, count).astype(float), -0.5, 25.0, int(rng.integers(1, 12))
    assert np.array_equal(_merge(*tables, *rule), plain_merge(*tables, *rule))


def test_borders_bend_by_the_mean_normals_on_their_sides():
    steps = seen(box(0.1, 0.14, 0.2), corner_view(3, 0.9), "kinect")
    patches = steps.patches
    points, normals, labels = patches.cloud.points, patches.normals, patches.labels
    near = neighbourhood(points, 2.5 * patches.cloud.size)
    sides = np.stack(
        [
            normals[j[labels[j] == labels[i]]].sum(axis=0)
            for i, j in enumerate(np.split(near.indices, near.indptr[1:-1]))
        ]
    )
    sides /= np.linalg.norm(sides, axis=1, keepdims=True)
    means = np.stack([normals[labels == p].mean(axis=0) for p in range(patches.count)])
    means /= np.linalg.norm(means, axis=1, keepdims=True)
    own = np.array([np.arccos(np.clip(normals[labels == p] @ means[p], -1, 1)).mean() for p in range(patches.count)])
    curved = np.minimum(own, np.radians(15))
    slack, length = np.zeros((patches.count,) * 2), np.zeros((patches.count,) * 2)
    for i, j in zip(patches.adjacent.rows, patches.adjacent.indices, strict=True):
        a, b = labels[i], labels[j]
        if a != b:
            slack[a, b] += curved[a] + curved[b] - np.arccos(np.clip(sides[i] @ sides[j], -1, 1))
            length[a, b] += 1
    ours = _borders(patches, near)
    assert np.array_equal(ours[1], length)
    assert np.allclose(ours[0], slack, atol=1e-9)
