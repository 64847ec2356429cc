from __future__ import annotations

import numpy as np
import pytest

from tests.worker.simulation.triangles import signed_distance, spread, volume
from worker.simulation.params import PrototypeParams, SimulationParams
from worker.simulation.primitives import Box, Cylinder, Primitive, Sphere
from worker.simulation.sensor import disparity_step

CHORD = PrototypeParams().chord
PRIMITIVES = [Box(0.1, 0.05, 0.2), Cylinder(0.015, 0.2), Cylinder(0.1, 0.03), Sphere(0.015), Sphere(0.1)]
every_primitive = pytest.mark.parametrize("primitive", PRIMITIVES, ids=str)


def true_volume(primitive: Primitive) -> float:
    if isinstance(primitive, Box):
        return primitive.length * primitive.width * primitive.height
    if isinstance(primitive, Cylinder):
        return np.pi * primitive.radius**2 * primitive.height
    assert isinstance(primitive, Sphere)
    return 4 / 3 * np.pi * primitive.radius**3


@every_primitive
def test_a_mesh_is_closed(primitive: Primitive) -> None:
    triangles = primitive.mesh(CHORD).triangles
    directed = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    assert len(np.unique(directed, axis=0)) == len(directed)
    assert {tuple(edge) for edge in directed} == {tuple(edge) for edge in directed[:, ::-1]}


@every_primitive
def test_a_mesh_faces_outward_and_has_the_volume_of_its_primitive(primitive: Primitive) -> None:
    assert volume(primitive.mesh(1e-6)) == pytest.approx(true_volume(primitive), rel=1e-3)


@every_primitive
@pytest.mark.parametrize("chord", [1e-5, CHORD, 1e-3])
def test_a_mesh_is_nowhere_farther_than_the_chord_from_the_surface(primitive: Primitive, chord: float) -> None:
    mesh = primitive.mesh(chord)
    middles_of_sides = (mesh.vertices[mesh.triangles] + mesh.vertices[np.roll(mesh.triangles, 1, axis=1)]) / 2
    on_triangles = np.concatenate([middles_of_sides.reshape(-1, 3), spread(mesh, 50_000, np.random.default_rng(0))])
    assert np.abs(primitive.signed_distance(on_triangles)).max() <= chord
    assert np.abs(primitive.signed_distance(mesh.vertices)).max() < 1e-12


def test_the_sensor_sees_no_facets() -> None:
    params = SimulationParams()
    finest = disparity_step(np.array(params.camera.nearest), params)
    assert params.prototypes.chord < finest / 20


@every_primitive
def test_the_surface_lies_on_the_surface_and_is_even(primitive: Primitive) -> None:
    points = primitive.surface()
    assert np.abs(primitive.signed_distance(points)).max() < 1e-12
    by_chance = spread(primitive.mesh(1e-5), 100_000, np.random.default_rng(1))
    shares, true_shares = (
        np.bincount(primitive.faces(p), minlength=primitive.face_count) / len(p) for p in (points, by_chance)
    )
    assert shares == pytest.approx(true_shares, abs=0.01)
    assert (points**2).mean(axis=0) == pytest.approx((by_chance**2).mean(axis=0), rel=0.03)


@every_primitive
def test_the_signed_distance_is_the_distance_to_the_nearest_point_of_the_surface(primitive: Primitive) -> None:
    points = np.random.default_rng(1).uniform(-0.15, 0.15, (2000, 3))
    assert primitive.signed_distance(points) == pytest.approx(signed_distance(primitive.mesh(1e-5), points), abs=2e-5)


@every_primitive
def test_normals_are_where_the_distance_grows_fastest(primitive: Primitive) -> None:
    points = primitive.surface()
    normals = primitive.normals(points)
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1)
    for step in (1e-6, -1e-6):
        moved = primitive.signed_distance(points + step * normals)
        # A point within a step of an edge is nearer to the other face.
        assert (np.abs(moved - step) < 1e-9).mean() > 0.99


def test_faces_are_numbered_as_told() -> None:
    middles = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]]) * [0.05, 0.1, 0.2]
    assert Box(0.1, 0.2, 0.4).faces(middles).tolist() == [0, 1, 2, 3, 4, 5]
    assert Cylinder(0.1, 0.2).faces(np.array([[0.1, 0, 0], [0, 0, 0.1], [0, 0, -0.1]])).tolist() == [0, 1, 2]
    assert Sphere(0.1).faces(np.array([[0, 0.1, 0]])).tolist() == [0]
