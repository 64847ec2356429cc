from __future__ import annotations

from itertools import islice
from typing import Any

import numpy as np
import pytest
from joblib import parallel_config
from joblib.parallel import get_active_backend

from service.engine.errors import InvalidParameter
from worker.simulation import SimulatedObject, SimulationParams, simulate
from worker.simulation.params import CameraParams

# A Kinect of a quarter of the resolution: the laws are the same.
SMALL = SimulationParams(
    renderer="raycast", min_points=60, camera=CameraParams(width=160, height=120, focal=131.25, farthest=1.0)
)


def objects(count: int, seed: int, **choices: Any) -> list[SimulatedObject]:
    return list(simulate(count, seed, **{"params": SMALL, "workers": 1, **choices}))


def equal(one: SimulatedObject, other: SimulatedObject) -> bool:
    return (
        one.index == other.index
        and np.array_equal(one.cloud.points, other.cloud.points)
        and np.array_equal(one.labels, other.labels)
        and np.array_equal(one.faces, other.faces)
        and np.array_equal(one.view.pose, other.view.pose)
        and one.order == other.order
        and all(
            (p.kind, p.dimensions) == (q.kind, q.dimensions) and np.array_equal(p.pose, q.pose)
            for p, q in zip(one.composition.prototypes, other.composition.prototypes, strict=True)
        )
    )


@pytest.fixture(params=["raycast", "sapien"])
def renderer(request: pytest.FixtureRequest) -> str:
    if request.param == "sapien":
        request.getfixturevalue("sapien")
    return str(request.param)


def test_any_number_of_workers_gives_the_same_bits(renderer: str, monkeypatch: pytest.MonkeyPatch) -> None:
    alone = objects(12, 3, renderer=renderer)
    monkeypatch.setattr("worker.simulation.ROUND", 5)  # objects come in rounds: more than one of them
    together = objects(12, 3, workers=2, renderer=renderer)
    with parallel_config(backend="threading", n_jobs=3):
        in_threads = objects(12, 3, workers=None, renderer=renderer)
    assert len(alone) == len(together) == len(in_threads) == 12
    assert all(map(equal, alone, together))
    assert all(map(equal, alone, in_threads))


def test_the_number_of_workers_is_not_imposed_on_what_is_done_with_the_objects() -> None:
    backend, workers = get_active_backend()
    for _ in simulate(2, 1, params=SMALL, workers=2):
        now = get_active_backend()
        assert (type(now[0]), now[1]) == (type(backend), workers)


def test_an_object_depends_on_seed_and_index_alone() -> None:
    np.random.seed(1)  # noqa: NPY002  what others do with numpy's own generator has no part in it
    few, many = objects(4, 3), objects(9, 3)
    assert all(map(equal, few, many[:4]))


def test_no_two_objects_of_any_seeds_are_alike() -> None:
    # Seeds and indices that follow each other: their generators must not.
    seen = [simulated for seed in (3, 4, 5) for simulated in objects(4, seed, orders=(2,))]
    assert len({simulated.cloud.points.tobytes() for simulated in seen}) == 12
    assert len({simulated.composition.prototypes[0].dimensions for simulated in seen}) == 12


def test_noise_and_renderer_change_what_is_seen_of_the_same_objects(renderer: str) -> None:
    clean, noisy = (objects(5, 1, noise=noise, renderer=renderer) for noise in ("none", "kinect"))
    for one, other in zip(clean, noisy, strict=True):
        assert np.array_equal(one.view.pose, other.view.pose)
        assert one.composition.prototypes[0].dimensions == other.composition.prototypes[0].dimensions
        assert not np.array_equal(one.cloud.points, other.cloud.points)
        assert len(other.cloud.points) == pytest.approx(len(one.cloud.points), rel=0.3)


@pytest.mark.parametrize("orders", [(1, 2, 3, 4, 5), (2, 5), (4,)])
def test_every_stretch_of_objects_has_an_equal_share_of_each_order(orders: tuple[int, ...]) -> None:
    seen = [simulated.order for simulated in objects(12, 0, orders=orders)]
    for end in range(1, len(seen) + 1):
        shares = [seen[:end].count(order) for order in orders]
        assert sum(shares) == end
        assert max(shares) - min(shares) <= 1


def test_objects_come_in_the_order_of_their_index_and_are_told_before_they_are_handed_on() -> None:
    told: list[int] = []
    for place, simulated in enumerate(
        simulate(7, 0, params=SMALL, workers=2, on_object=lambda o: told.append(o.index))
    ):
        assert simulated.index == place
        assert told == list(range(place + 1))


def test_endless_simulations_can_be_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("worker.simulation.ROUND", 5)
    assert [simulated.index for simulated in islice(simulate(10**12, 0, params=SMALL), 3)] == [0, 1, 2]


def test_no_objects_are_no_error() -> None:
    assert objects(0, 0) == []


def test_points_without_noise_lie_on_the_outer_surface(renderer: str) -> None:
    for simulated in objects(10, 5, noise="none", renderer=renderer):
        points = simulated.view.to_composition(simulated.cloud.points.astype(np.float64))
        distances = np.stack([prototype.signed_distance(points) for prototype in simulated.composition.prototypes])
        own = distances[simulated.labels, np.arange(len(points))]
        assert np.abs(own).max() < 1e-4  # 0.1 mm
        assert distances.min(axis=0).min() > -1e-4, "a point is inside another prototype"


def test_points_without_noise_lie_on_faces_that_the_camera_sees(renderer: str) -> None:
    for simulated in objects(10, 6, noise="none", renderer=renderer):
        points = simulated.cloud.points.astype(np.float64)
        there = simulated.view.to_composition(points)
        normals = simulated.composition.normals(there, simulated.labels.astype(np.int64))
        away = np.einsum("ij,ij->i", there - simulated.view.pose[:3, 3], normals)
        assert (away < 0).mean() > 0.995  # at an edge, either face may be named


@pytest.mark.parametrize("noise", ["none", "kinect"])
def test_labels_and_faces_belong_to_the_points_and_to_each_other(noise: str) -> None:
    faces_of = {"box": 6, "cylinder": 3, "sphere": 1}
    for simulated in objects(10, 7, noise=noise):
        assert simulated.cloud.points.dtype == np.float32
        assert simulated.labels.dtype == simulated.faces.dtype == np.int32
        assert len(simulated.labels) == len(simulated.faces) == len(simulated.cloud.points)
        counts = [faces_of[prototype.kind] for prototype in simulated.composition.prototypes]
        assert np.array_equal(np.repeat(np.arange(len(counts)), counts)[simulated.faces], simulated.labels)


def test_noisy_points_lie_near_the_surface_they_are_labelled_with() -> None:
    for simulated in objects(10, 8, noise="kinect"):
        points = simulated.view.to_composition(simulated.cloud.points.astype(np.float64))
        distances = np.stack([prototype.signed_distance(points) for prototype in simulated.composition.prototypes])
        own = np.abs(distances[simulated.labels, np.arange(len(points))])
        assert 1e-4 < np.median(own) < 4e-3
        assert np.quantile(own, 0.99) < 0.03


def test_an_object_of_which_too_little_is_seen_is_drawn_anew() -> None:
    least = 400
    many = objects(10, 9, orders=(1,))
    assert any(len(simulated.cloud.points) < least for simulated in many)
    enough = objects(10, 9, orders=(1,), params=SMALL.model_copy(update={"min_points": least}))
    assert all(len(simulated.cloud.points) >= least for simulated in enough)
    for first, anew in zip(many, enough, strict=True):
        assert equal(first, anew) == (len(first.cloud.points) >= least)


def test_an_object_that_cannot_be_seen_ends_in_advice(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("worker.simulation.MAX_DRAWS", 20)
    params = SMALL.model_copy(update={"camera": CameraParams(width=16, height=16, focal=20), "min_points": 257})
    with pytest.raises(InvalidParameter, match="fewer points"):
        objects(1, 0, params=params, orders=(1,))


@pytest.mark.parametrize(
    "choices",
    [
        {"count": -1},
        {"seed": -1},
        {"workers": 0},
        {"orders": (0,)},
        {"orders": ()},
        {"noise": "gaussian"},
        {"renderer": "gazebo"},
    ],
    ids=str,
)
def test_bad_arguments_are_refused_before_anything_is_simulated(choices: dict[str, Any]) -> None:
    with pytest.raises(InvalidParameter):
        simulate(**{"count": 1, "seed": 0, "params": SMALL, **choices})
