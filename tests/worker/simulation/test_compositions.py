from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chisquare, kstest

from tests.worker.simulation.triangles import inside, signed_distance, spread, surfaces_cross
from worker.simulation.compositions import KINDS, Composition, Kind, Prototype, compose, crosses, draw_dimensions
from worker.simulation.params import PrototypeParams

PARAMS = PrototypeParams()
UNLIKELY = 1e-4


def composed(order: int, seed: int) -> Composition:
    return compose(order, PARAMS, np.random.default_rng(seed))


def at(kind: Kind, dimensions: tuple[float, ...], *place: float) -> Prototype:
    pose = np.eye(4)
    pose[:3, 3] = place
    return Prototype(kind, dimensions, pose)


def meshes_cross(one: Prototype, other: Prototype) -> bool:
    return surfaces_cross(one.mesh(PARAMS.chord), other.mesh(PARAMS.chord))


@pytest.mark.parametrize(
    ("apart", "cross"), [(0.0, False), (0.059, False), (0.061, True), (0.139, True), (0.141, False), (0.3, False)]
)
def test_the_judge_tells_nested_from_crossing_from_separate_balls(apart: float, cross: bool) -> None:
    assert meshes_cross(at("sphere", (0.1,), 0, 0, 0), at("sphere", (0.04,), apart, 0, 0)) == cross


@pytest.mark.parametrize("seed", range(12))
def test_the_mesh_of_every_further_prototype_crosses_that_of_an_earlier_one(seed: int) -> None:
    prototypes = composed(5, seed).prototypes
    for index in range(1, len(prototypes)):
        assert any(meshes_cross(prototypes[index], earlier) for earlier in prototypes[:index])


@pytest.mark.parametrize("exposed", [PARAMS.exposed, 0.5])
def test_no_prototype_is_swallowed_by_the_others(exposed: float) -> None:
    for seed in range(10):
        composition = compose(5, PrototypeParams(exposed=exposed), np.random.default_rng(seed))
        meshes = [prototype.mesh(1e-4) for prototype in composition.prototypes]
        for mesh in meshes:
            surface = spread(mesh, 2000, np.random.default_rng(0))
            hidden = np.any([inside(other, surface) for other in meshes if other is not mesh], axis=0)
            assert 1 - hidden.mean() > exposed - 0.03  # both shares are counted on points


@pytest.mark.parametrize("overlap", [PARAMS.overlap, PARAMS.shortest / 4])
def test_prototypes_reach_as_deep_into_each_other_as_asked(overlap: float) -> None:
    for seed in range(12):
        rng = np.random.default_rng(seed)
        composition = compose(2, PrototypeParams(overlap=overlap), rng)
        one, other = (prototype.mesh(1e-4) for prototype in composition.prototypes)
        into_one = signed_distance(one, np.concatenate([other.vertices, spread(other, 5000, rng)])).min()
        into_other = signed_distance(other, np.concatenate([one.vertices, spread(one, 5000, rng)])).min()
        assert min(into_one, into_other) < -0.8 * overlap


def test_a_ball_inside_a_box_does_not_cross_it() -> None:
    ball, box = at("sphere", (0.05,), 0, 0, 0), at("box", (0.2, 0.2, 0.2), 0, 0, 0)
    assert not crosses(ball, (box,), PARAMS.overlap)
    assert not crosses(box, (ball,), PARAMS.overlap)


def test_what_lies_apart_or_only_touches_does_not_cross() -> None:
    box = at("box", (0.1, 0.1, 0.1), 0, 0, 0)
    assert not crosses(at("box", (0.1, 0.1, 0.1), 0.1, 0, 0), (box,), PARAMS.overlap)
    assert not crosses(at("cylinder", (0.05, 0.1), 0.2, 0, 0), (box,), PARAMS.overlap)


def test_boxes_apart_whose_bounding_boxes_meet_do_not_cross() -> None:
    corner = at("sphere", (0.1,), 0.145, 0.145, 0)  # beyond the ball's surface, within its bounds
    assert not crosses(corner, (at("sphere", (0.1,), 0, 0, 0),), PARAMS.overlap)


def test_bars_cross_though_no_corner_is_inside_the_other() -> None:
    bars = at("box", (0.2, 0.03, 0.03), 0, 0, 0), at("box", (0.03, 0.2, 0.03), 0, 0, 0)
    assert crosses(bars[0], bars[1:], PARAMS.overlap)
    assert meshes_cross(*bars)


def test_what_counts_as_crossing_crosses_and_what_is_far_apart_does_not() -> None:
    rng = np.random.default_rng(5)
    agreed = 0
    for seed in range(60):
        one, other = (composed(1, 2 * seed + k).prototypes[0] for k in range(2))
        pose = composed(2, seed).prototypes[1].pose.copy()
        pose[:3, 3] = rng.uniform(-0.15, 0.15, 3)
        placed = Prototype(other.kind, other.dimensions, pose)
        said, true = crosses(placed, (one,), PARAMS.overlap), meshes_cross(placed, one)
        assert true or not said
        agreed += said == true
    assert agreed >= 54  # shallow crossings may be refused


def test_orders_dimensions_and_poses_are_as_asked() -> None:
    for order in range(1, 6):
        composition = composed(order, order)
        assert composition.order == len(composition.prototypes) == order
        assert np.array_equal(composition.prototypes[0].pose, np.eye(4))
        for prototype in composition.prototypes:
            turn = prototype.pose[:3, :3]
            assert turn @ turn.T == pytest.approx(np.eye(3), abs=1e-12)
            assert np.linalg.det(turn) == pytest.approx(1)
            scale = {"box": [1, 1, 1], "cylinder": [2, 1], "sphere": [2]}[prototype.kind]
            lengths = np.multiply(prototype.dimensions, scale)
            assert ((lengths >= PARAMS.shortest) & (lengths <= PARAMS.longest)).all()


def test_prototypes_join_one_after_the_other_and_stay_where_they_are() -> None:
    for seed in range(5):
        whole = composed(5, seed)
        for order in range(1, 5):
            for prototype, later in zip(composed(order, seed).prototypes, whole.prototypes[:order], strict=True):
                assert (prototype.kind, prototype.dimensions) == (later.kind, later.dimensions)
                assert np.array_equal(prototype.pose, later.pose)


def test_all_kinds_are_equally_likely_in_every_place() -> None:
    kinds = np.array([[KINDS.index(p.kind) for p in composed(3, seed).prototypes] for seed in range(400)])
    for place in range(3):
        assert chisquare(np.bincount(kinds[:, place], minlength=3)).pvalue > UNLIKELY


@pytest.mark.parametrize(("kind", "scale"), [("box", (1, 1, 1)), ("cylinder", (2, 1)), ("sphere", (2,))])
def test_edges_heights_and_diameters_are_uniform_over_their_range(kind: Kind, scale: tuple[int, ...]) -> None:
    rng = np.random.default_rng(5)
    params = PrototypeParams(shortest=0.05, longest=0.11)
    lengths = np.multiply([draw_dimensions(kind, params, rng) for _ in range(1000)], scale)
    for drawn in lengths.T:
        assert kstest((drawn - 0.05) / 0.06, "uniform").pvalue > UNLIKELY


def test_orientations_favour_no_direction() -> None:
    rng = np.random.default_rng(4)
    axes = np.array([compose(2, PARAMS, rng).prototypes[1].pose[:3, 2] for _ in range(300)])
    # A point uniform on the sphere has the covariance I / 3.
    assert axes.T @ axes / len(axes) == pytest.approx(np.eye(3) / 3, abs=0.08)


def test_faces_are_numbered_through_the_composition() -> None:
    composition = Composition(
        (at("box", (0.1, 0.1, 0.1), 0, 0, 0), at("cylinder", (0.02, 0.2), 0, 0, 0), at("sphere", (0.03,), 0, 0, 0.1))
    )
    points = np.array([[0.05, 0, 0], [0, 0, -0.1], [0, 0, 0.13]])
    labels = np.array([0, 1, 2])
    assert composition.faces(points, labels).tolist() == [1, 6 + 2, 6 + 3]
    assert composition.normals(points, labels) == pytest.approx(np.array([[1, 0, 0], [0, 0, -1], [0, 0, 1]]))


def test_the_bounding_sphere_holds_the_object_tightly() -> None:
    for seed in range(5):
        composition = composed(4, seed)
        middle, radius = composition.bounding_sphere()
        farthest = max(np.linalg.norm(p.surface() - middle, axis=1).max() for p in composition.prototypes)
        assert 0.9 * radius < farthest <= radius + 1e-3
