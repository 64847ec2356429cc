"""What the tests of Train share: a store with a model and a labelled dataset, a service, a worker."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from service.clouds import write_ply
from service.datasets import Datasets
from service.labels import Label
from tests.acceptance.jobs_place import Place, free_port
from tests.learnt import learnt, objects

if TYPE_CHECKING:
    pass


@pytest.fixture
def place(tmp_path: Path) -> Place:
    """A store with a model of 14 objects, `toys:1`, and these objects, labelled, as the dataset `shelf`."""
    place = Place(tmp_path)
    place.store.publish(learnt(), name="toys", seed=5, source={"kind": "simulation"})
    datasets = Datasets(place.store.url)
    datasets.create("shelf")
    for number, simulated in enumerate(objects()):
        datasets.add("shelf", f"{number}.ply", write_ply(simulated.cloud))
    datasets.label("shelf", {f"{number}.ply": Label(category=f"kind {number % 2}") for number in range(14)})
    return place


@pytest.fixture
def host(place: Place) -> Iterator[str]:
    port = free_port()
    with place.api(port):
        yield f"http://127.0.0.1:{port}"


@pytest.fixture
def worker(place: Place) -> Iterator[None]:
    with place.worker("worker"):
        yield
