"""Where training clouds come from: a folder of files, or mental simulation."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Protocol

from service import clouds
from service.engine.errors import InvalidParameter, ShapeConceptsError, UnreadableCloud
from worker.learning.observations import NamedCloud
from worker.simulation import SimulationParams, simulate

BESIDE = {".csv", ".json", ".png"}  # tables, manifests and pictures stand beside clouds, though clouds may end so


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
        endings = {ending for known in clouds.FORMATS.values() for ending in known.endings} - BESIDE
        if not path.is_dir():
            raise InvalidParameter(f"There is no folder {path}.")
        found = (file for file in path.rglob("*") if file.suffix.lower() in endings and file.is_file())
        self.path, self.files = path, sorted(found, key=lambda file: file.relative_to(path).as_posix())
        self.refused: list[tuple[str, ShapeConceptsError]] = []
        if not self.files:
            raise InvalidParameter(f"The folder {path} holds no cloud: no file ends in {', '.join(sorted(endings))}.")

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
            yield NamedCloud(f"simulated/{self.seed}/{simulated.index}", simulated.cloud)

    def describe(self) -> dict[str, Any]:
        """Everything that makes the same objects again."""
        parameters = self.params.model_dump(mode="json")
        return {"kind": "simulation", "clouds": self.count, "seed": self.seed, "parameters": parameters}
