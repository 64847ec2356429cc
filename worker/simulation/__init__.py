"""Mental simulation: abstract artificial objects, composed at random and seen by a virtual depth camera.

Paper: "Machine-Centric Concept Generation Through Mental Simulation", Alg. 1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass

import numpy as np
from joblib import Parallel, delayed, effective_n_jobs, parallel_config
from numpy.typing import NDArray

from service.engine.cloud import PointCloud
from service.engine.errors import InvalidParameter, RendererUnavailable
from worker.simulation.camera import DepthImage, View, draw_view
from worker.simulation.compositions import Composition, Prototype, compose
from worker.simulation.params import SimulationParams
from worker.simulation.sensor import measure

__all__ = ["Composition", "Prototype", "SimulatedObject", "SimulationParams", "View", "simulate"]

ROUND = 64  # objects simulated before the first of them is handed on: bounds the memory that waiting ones take
EACH = 8  # or as many for each worker, where that is more
MAX_DRAWS = 1000


@dataclass(frozen=True)
class SimulatedObject:
    """An abstract object as the virtual sensor saw it, and what is true of it.

    Attributes:
        index: its place in the simulation, from 0.
        cloud: what the sensor measured, in the camera's frame.
        composition: the prototypes.
        view: from where it was seen.
        labels: (N,) int32, index of the prototype that each point was measured on.
        faces: (N,) int32, the smooth face that each point was measured on, numbered through the composition in the
            order of its prototypes: 6 faces of a box, side, lid and bottom of a cylinder, 1 of a sphere.
    """

    index: int
    cloud: PointCloud
    composition: Composition
    view: View
    labels: NDArray[np.int32]
    faces: NDArray[np.int32]

    @property
    def order(self) -> int:
        """The prototype order."""
        return self.composition.order


def simulate(
    count: int,
    seed: int,
    *,
    orders: Sequence[int] | None = None,
    noise: str | None = None,
    renderer: str | None = None,
    workers: int | None = None,
    on_object: Callable[[SimulatedObject], None] | None = None,
    params: SimulationParams | None = None,
) -> Iterator[SimulatedObject]:
    """Simulates abstract objects, one after the other; those of one seed are the same for any number of workers.

    Orders take turns, so every stretch of objects has an equal share of each.

    Args:
        count: number of objects.
        seed: not negative; object i draws from a generator of its own, that of (seed, i).
        orders: prototype orders; None as in `params`, where the default is 1 to 5.
        noise: "kinect" or "none"; None as in `params`.
        renderer: "sapien" or "raycast"; None as in `params`. One never stands in for the other.
        workers: number of processes; None as the surrounding `joblib.parallel_config` has it.
        on_object: called with each object before it is handed on.
        params: everything else.

    Yields:
        The objects in the order of their index.

    Raises:
        InvalidParameter: at once, where an argument is out of its range.
        RendererUnavailable: at once, where SAPIEN cannot render here.
    """
    chosen = (params or SimulationParams()).but(orders=orders, noise=noise, renderer=renderer)
    if count < 0 or seed < 0:
        raise InvalidParameter(f"count and seed are not negative; they were {count} and {seed}.")
    if workers is not None and workers < 1:
        raise InvalidParameter(f"The number of workers is at least 1; it was {workers}.")
    require_renderer(chosen)
    return _simulate(count, seed, chosen, workers, on_object or (lambda _: None))


def require_renderer(params: SimulationParams) -> None:
    """Makes sure that objects can be rendered.

    Raises:
        RendererUnavailable: SAPIEN is to render, and cannot here.
    """
    if params.renderer == "sapien":
        from worker.simulation.scene import unavailable

        if reason := unavailable():
            raise RendererUnavailable(reason)


def _simulate(
    count: int,
    seed: int,
    params: SimulationParams,
    workers: int | None,
    on_object: Callable[[SimulatedObject], None],
) -> Iterator[SimulatedObject]:
    first = 0
    while first < count:
        # The number of workers is set around each round, not around what is done with its objects.
        with parallel_config(backend="loky", n_jobs=workers) if workers else nullcontext():
            indices = range(first, min(first + max(ROUND, EACH * effective_n_jobs()), count))
            objects = Parallel()(delayed(simulate_object)(index, seed, params) for index in indices)
        first = indices.stop
        for simulated in objects:
            on_object(simulated)
            yield simulated


def simulate_object(index: int, seed: int, params: SimulationParams) -> SimulatedObject:
    """The object of that index: composed, seen and measured; drawn again while the sensor sees too little of it."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(index,)))
    order = params.orders[index % len(params.orders)]
    for _ in range(MAX_DRAWS):
        composition = compose(order, params.prototypes, rng)
        view = draw_view(composition, params.camera, rng)
        image = _render(composition, view, params)
        cloud, labels, faces = measure(image, composition, view, params, rng)
        if len(cloud.points) >= params.min_points:
            return SimulatedObject(index, cloud, composition, view, labels, faces)
    raise InvalidParameter(
        f"In {MAX_DRAWS} draws no object of order {order} gave the sensor {params.min_points} points. "
        "Allow larger objects, a nearer camera or fewer points."
    )


def _render(composition: Composition, view: View, params: SimulationParams) -> DepthImage:
    # Each renderer's library is heavy, and only one of them is needed.
    if params.renderer == "sapien":
        from worker.simulation.scene import render
    else:
        from worker.simulation.raycast import render
    return render(composition, view, params.camera, params.prototypes.chord)
