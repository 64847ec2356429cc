"""What the tests of the page share: a browser, and a service to visit."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from service.clouds import write_ply
from service.datasets import Datasets
from service.labels import Label
from tests.acceptance.browsing import DESKTOP, Visit, chromium
from tests.acceptance.jobs_place import Place, free_port
from tests.acceptance.page.visiting import Visiting
from tests.learnt import learnt, objects

if TYPE_CHECKING:
    from playwright.sync_api import Browser


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as browser:
        yield browser


@pytest.fixture(scope="module")
def host(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A service with a model of objects of which some have labels, `toys:1`."""
    place = Place(tmp_path_factory.mktemp("place"))
    datasets = Datasets(place.store.url)
    datasets.create("shelf")
    for number in range(6):
        datasets.add("shelf", f"{number}.ply", write_ply(objects()[number].cloud))
    datasets.label("shelf", {f"{number}.ply": Label(category="ball" if number % 3 else "brick") for number in range(6)})
    keys = tuple(f"shelf/{number}.ply" if number < 6 else f"simulated/5/{number}" for number in range(14))
    model = dataclasses.replace(learnt(), prototypes=dataclasses.replace(learnt().prototypes, cloud_keys=keys))
    source = {"kind": "joined", "clouds": 14, "parts": [{"kind": "dataset", "name": "shelf", "clouds": 6}]}
    place.store.publish(model, name="toys", seed=5, source=source)
    port = free_port()
    with place.api(port):
        yield f"http://127.0.0.1:{port}"


@pytest.fixture
def visit(browser: Browser, host: str) -> Iterator[Visiting]:
    """Opens the page; in the end the browser had nothing to complain about, unless the test looked itself."""
    opened: list[Visit] = []

    def opening(place: str, size: tuple[int, int] = DESKTOP, scheme: str = "light", at: str = host) -> Visit:
        opened.append(Visit(browser, at, size, scheme))
        opened[-1].open(place)
        return opened[-1]

    yield opening
    for one in opened:
        one.close()
