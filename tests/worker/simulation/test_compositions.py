from __future__ import annotations

import numpy as np
import pytest

from tests.worker.simulation.triangles import inside, spread, surfaces_cross
from worker.simulation.compositions import KINDS, Composition, Kind, Prototype, compose, crosses
from worker.simulation.params import PrototypeParams

PARAMS = PrototypeParams()


def composed(order: int, seed: int) -> Composition:
    return compose(order, PARAMS, np.random.default_rng(seed))


def at(kind: Kind, dimensions: tuple[float, ...], *place: float) -> Prototype:
    pose = np.eye(4)
    pose[:3, 3] = place
    return Prototype(kind, dimensions, pose)


def meshes_cross(one: Prototype, other: Prototype) -> bool:
    return surfaces_cross(one.mesh(PARAMS.chord), other.mesh(PARAMS.chord))


@pytest.mark.parametrize("seed", range(12))
def test_the_mesh_of_every_further_prototype_crosses_that_of_an_earlier_one(seed: int) -> None:
    prototypes = composed(5, seed).prototypes
    for index in range(1, len(prototypes)):
        assert any(meshes_cross(prototypes[index], earlier) for earlier in prototypes[:index])


@pytest.mark.parametrize("seed", range(12))
def test_no_prototype_is_swallowed_by_the_others(seed: int) -> None:
    prototypes = composed(5, seed).prototypes
    meshes = [prototype.mesh(PARAMS.chord) for prototype in prototypes]
    for mesh in meshes:
        surface = spread(mesh, 2000, np.random.default_rng(0))
        hidden = np.any([inside(other, surface) for other in meshes if other is not mesh], axis=0)
        assert hidden.mean() < 1 - 0.8 * PARAMS.exposed


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


def test_every_kind_is_drawn_about_equally_often() -> None:
    rng = np.random.default_rng(3)
    kinds = [compose(1, PARAMS, rng).prototypes[0].kind for _ in range(600)]
    assert all(kinds.count(kind) == pytest.approx(200, abs=50) for kind in KINDS)


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


def test_the_bounding_sphere_holds_the_object() -> None:
    for seed in range(5):
        composition = composed(4, seed)
        middle, radius = composition.bounding_sphere()
        for prototype in composition.prototypes:
            assert np.linalg.norm(prototype.surface() - middle, axis=1).max() <= radius + 1e-3
