"""Super patches: the faces that a person would name, and which of them are adjacent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sklearn.metrics import adjusted_rand_score

from service.engine.params import SegmentParams
from service.engine.segments import SegmentGraph, merge_patches
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
