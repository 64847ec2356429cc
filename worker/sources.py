"""Where training clouds come from: a folder of files, datasets of the store, mental simulation, or several of these."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from service import clouds
from service.clouds.formats import CLOUD_ENDINGS
from service.dataset_records import digest_of
from service.datasets import Datasets
from service.engine.cloud import PointCloud
from service.engine.errors import InvalidParameter, ShapeConceptsError, UnreadableCloud
from worker.learning.observations import NamedCloud
from worker.simulation import SimulationParams, require_renderer, simulate, simulate_object


class Source(Protocol):
    """Training clouds, and what the manifest says of them."""

    refused: list[tuple[str, ShapeConceptsError]]
    """Clouds that could not be read, after they were iterated over: each one's name and what is wrong with it."""

    @property
    def count(self) -> int:
        """How many clouds there are, the unreadable ones included."""

    def __iter__(self) -> Iterator[NamedCloud]:
        """The clouds, in an order that is part of the input."""

    def describe(self) -> dict[str, Any]:
        """For the manifest: JSON-able, and the same for the same input."""


class Folder:
    """All clouds in a folder and below it, by the order of their paths.

    Args:
        path: of the folder.

    Raises:
        InvalidParameter: it is no folder, or holds no cloud.
    """

    def __init__(self, path: Path) -> None:
        if not path.is_dir():
            raise InvalidParameter(f"There is no folder {path}.")
        found = (file for file in path.rglob("*") if file.suffix.lower() in CLOUD_ENDINGS and file.is_file())
        self.path, self.files = path, sorted(found, key=lambda file: file.relative_to(path).as_posix())
        self.refused: list[tuple[str, ShapeConceptsError]] = []
        if not self.files:
            raise InvalidParameter(
                f"The folder {path} holds no cloud: no file ends in {', '.join(sorted(CLOUD_ENDINGS))}."
            )

    @property
    def count(self) -> int:
        """Number of files."""
        return len(self.files)

    def __iter__(self) -> Iterator[NamedCloud]:
        """Reads file after file; those that cannot be read are refused."""
        self.refused.clear()
        for file in self.files:
            key = file.relative_to(self.path).as_posix()
            try:
                yield NamedCloud(key, clouds.read(file.read_bytes(), name=file.name))
            except (ShapeConceptsError, OSError) as error:
                refusal = error if isinstance(error, ShapeConceptsError) else UnreadableCloud(f"{error.strerror}.")
                self.refused.append((key, refusal))

    def describe(self) -> dict[str, Any]:
        """The kind and number of clouds; their hashes stand in the model."""
        return {"kind": "folder", "clouds": self.count}


class SimulatedCloud(NamedTuple):
    """The cloud of an abstract object that is yet to be simulated.

    Attributes:
        number: of the object.
        seed: of the simulation.
        params: of it.
    """

    number: int
    seed: int
    params: SimulationParams

    @property
    def key(self) -> str:
        """What it is called."""
        return f"simulated/{self.seed}/{self.number}"

    @property
    def cloud(self) -> PointCloud:
        """Simulates it."""
        return simulate_object(self.number, self.seed, self.params).cloud


class Simulation:
    """Abstract objects, simulated as they are needed.

    Args:
        count: number of objects.
        seed: not negative.
        params: how they are made and seen.
    """

    def __init__(self, count: int, seed: int, params: SimulationParams) -> None:
        self.count, self.seed, self.params = count, seed, params
        self.refused: list[tuple[str, ShapeConceptsError]] = []

    def __iter__(self) -> Iterator[NamedCloud]:
        """Simulates object after object."""
        for simulated in simulate(self.count, self.seed, params=self.params):
            yield NamedCloud(SimulatedCloud(simulated.index, self.seed, self.params).key, simulated.cloud)

    def unmade(self) -> Iterator[SimulatedCloud]:
        """The same clouds, each to be simulated where it is looked at.

        Raises:
            RendererUnavailable: SAPIEN cannot render here.
        """
        require_renderer(self.params)
        for number in range(self.count):
            yield SimulatedCloud(number, self.seed, self.params)

    def describe(self) -> dict[str, Any]:
        """Everything that makes the same objects again."""
        parameters = self.params.model_dump(mode="json")
        return {"kind": "simulation", "clouds": self.count, "seed": self.seed, "parameters": parameters}


class Dataset:
    """The clouds that a dataset has when this is made, by their keys; read from the store one by one.

    Args:
        datasets: of the store.
        name: of the dataset.

    Raises:
        DatasetNotFound: there is no such dataset.
        InvalidParameter: it holds no cloud.
    """

    def __init__(self, datasets: Datasets, name: str) -> None:
        self.name, self.entries = name, datasets.entries(name)
        self.refused: list[tuple[str, ShapeConceptsError]] = []
        self._datasets = datasets
        if not self.entries:
            raise InvalidParameter(f"The dataset '{name}' holds no cloud: add some first.")

    @property
    def count(self) -> int:
        """Number of clouds."""
        return len(self.entries)

    def __iter__(self) -> Iterator[NamedCloud]:
        """Reads cloud after cloud; those that cannot be read are refused.

        Raises:
            DatasetDamaged: the store has lost or altered one: what is learnt would not be what the manifest says.
        """
        self.refused.clear()
        for entry in self.entries:
            key, data = f"{self.name}/{entry.key}", self._datasets.content(entry)
            try:
                cloud = clouds.read(data, entry.format, name=entry.key, unit=entry.unit, viewpoint=entry.pose())
            except ShapeConceptsError as error:
                self.refused.append((key, error))
            else:
                yield NamedCloud(key, cloud)

    def describe(self) -> dict[str, Any]:
        """The dataset, and what it held."""
        return {"kind": "dataset", "name": self.name, "digest": digest_of(self.entries), "clouds": self.count}


class Joined:
    """Several sources, one after the other.

    Args:
        sources: their order is part of the input.
    """

    def __init__(self, sources: Sequence[Source]) -> None:
        self.sources = list(sources)
        self.refused: list[tuple[str, ShapeConceptsError]] = []

    @property
    def count(self) -> int:
        """Number of clouds of all sources."""
        return sum(source.count for source in self.sources)

    def __iter__(self) -> Iterator[NamedCloud]:
        """Source after source."""
        self.refused.clear()
        for source in self.sources:
            yield from source
            self.refused.extend(source.refused)

    def describe(self) -> dict[str, Any]:
        """What each of them says."""
        parts = [source.describe() for source in self.sources]
        return {"kind": "joined", "clouds": self.count, "parts": parts}
