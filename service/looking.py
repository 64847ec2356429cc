"""The use cases of those who look: points to draw, pictures of training objects, and what people say these are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from service.choosing import Choosing, Meant
from service.clouds import UNITS, SceneCloud
from service.datasets import Datasets
from service.engine.errors import InvalidParameter

MOST_DRAWN = 1_000_000
DRAWN = 100_000  # points of a cloud that are drawn unless another number is asked for: more, no screen shows
ON_A_SHEET = 256  # training objects


class DrawnPoints(NamedTuple):
    """An even sample of a cloud's points, for display.

    Attributes:
        points: (V, 3) float32: metres, in the sensor's frame; each beginning of them is an even sample as well.
        places: (V,) int32: the place of each point among those of the file.
        measured: how many points the sensor measured.
        in_file: how many points the file holds, missing ones included.
        viewpoint: x, y, z, qw, qx, qy, qz: the sensor's pose in the cloud's own frame, metres.
    """

    points: NDArray[np.float32]
    places: NDArray[np.int32]
    measured: int
    in_file: int
    viewpoint: tuple[float, ...]


class Drawing:
    """What is drawn of a cloud that is being answered: the answer then tells parts of these points, not of all.

    Args:
        most: points that are drawn at most.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self.drawn: DrawnPoints | None = None
        """None as long as the cloud is not read."""

    def begin(self, sent: SceneCloud) -> DrawnPoints:
        """Takes what is drawn of a cloud; returns it."""
        self.drawn = draw(sent, self._most)
        return self.drawn


class ObjectLabels(BaseModel):
    """What people say that the training objects of a version are; nothing is learnt from it."""

    model_config = ConfigDict(frozen=True)

    model: str = Field(description="name of the model")
    version: int = Field(ge=1, description="its version")
    labelled: int = Field(ge=0, description="training objects that have a label")
    categories: list[str | None] = Field(
        description="(N): the category of each training object, by its number, as its dataset has it now; null for none"
    )


def draw(sent: SceneCloud, most: int = DRAWN) -> DrawnPoints:
    """The points of a cloud to draw, no more than `most`: which ones follows from their number alone."""
    cloud = sent.cloud
    count = len(cloud.points)
    order = np.random.default_rng(0).random(count)  # quicker than to shuffle all: only those that are drawn are sorted
    chosen = np.argpartition(order, most)[:most] if count > most else np.arange(count)
    chosen = chosen[np.argsort(order[chosen])]
    of_file = np.arange(count) if cloud.measured is None else np.flatnonzero(cloud.measured)
    position = np.array(sent.pose.position) * UNITS[sent.unit]
    return DrawnPoints(
        points=cloud.points[chosen],
        places=of_file[chosen].astype(np.int32),
        measured=count,
        in_file=count if cloud.measured is None else len(cloud.measured),
        viewpoint=(*position.tolist(), *sent.pose.orientation),
    )


class Looking:
    """What is shown of a model's training objects.

    Args:
        choosing: finds the models.
        datasets: of the store: clouds have labels there.
    """

    def __init__(self, choosing: Choosing, datasets: Datasets) -> None:
        self._choosing = choosing
        self._datasets = datasets

    def thumbnail(self, name: str, version: int, number: int) -> NDArray[np.uint8]:
        """A training object of a version as the sensor saw it (48, 48), shaded; 0 is background.

        Raises:
            InvalidParameter: the model has no training object of that number.
        """
        return self.sheet(name, version, [number])

    def sheet(self, name: str, version: int, numbers: Sequence[int]) -> NDArray[np.uint8]:
        """Training objects of a version side by side (48, 48 n), as `thumbnail` shows each.

        Raises:
            InvalidParameter: the model has no training object of some number, or they are too many.
        """
        thumbnails = self._meant(name, version).model().prototypes.thumbnails
        if not 1 <= len(numbers) <= ON_A_SHEET:
            raise InvalidParameter(
                f"1 to {ON_A_SHEET} training objects are shown side by side; {len(numbers)} were asked for."
            )
        if missing := [number for number in numbers if not 0 <= number < len(thumbnails)]:
            raise InvalidParameter(
                f"{name}:{version} learnt from {len(thumbnails)} objects, numbered from 0; there is no {missing[0]}."
            )
        return np.concatenate(thumbnails[list(numbers)], axis=1)

    def labels(self, name: str, version: int) -> ObjectLabels:
        """What people say that a version's training objects are: those that came from datasets with labels."""
        meant = self._meant(name, version)
        said = self._said(_datasets_of(meant.source.store.manifest(name, version).source))
        categories = [said.get(key) for key in meant.model().prototypes.cloud_keys]
        labelled = sum(category is not None for category in categories)
        return ObjectLabels(model=name, version=version, labelled=labelled, categories=categories)

    def _meant(self, name: str, version: int) -> Meant:
        return self._choosing.meant(name, version)

    def _said(self, names: set[str]) -> dict[str, str]:
        """Categories by the keys that clouds of datasets have in training; nothing of those that are gone."""
        return {
            f"{name}/{key}": label.category
            for name in sorted(names)
            for key, label in self._datasets.labels(name).items()
        }


def _datasets_of(source: Mapping[str, Any]) -> set[str]:
    """Names of all datasets that a manifest's source tells of, its parts included."""
    own = {str(source["name"])} if source.get("kind") == "dataset" and "name" in source else set()
    return own.union(*(_datasets_of(part) for part in source.get("parts", [])))
