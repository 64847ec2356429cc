"""What is told of datasets: the dataset, its clouds, and what became of each cloud that was sent."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from datetime import datetime
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from service.clouds import Viewpoint
from service.engine.errors import ShapeConceptsError
from service.labels import Label
from service.model_file import NAME

Outcome = Literal["accepted", "replaced", "already-there", "refused", "left-out"]


class Entry(BaseModel):
    """A cloud of a dataset."""

    model_config = ConfigDict(frozen=True)

    key: str = Field(description="what the cloud is called in its dataset")
    sha256: str = Field(pattern="^[0-9a-f]{64}$", description="of the file's bytes, hexadecimal")
    bytes: int = Field(ge=0, description="length of the file, bytes")
    format: str = Field(description="of the file: pcd, ply, ...")
    points: int = Field(ge=1, description="points that the sensor measured")
    unit: str | None = Field(None, description="of the coordinates; null for the file's own, or metres")
    viewpoint: tuple[float, ...] | None = Field(
        None, description="pose of the sensor, x, y, z, qw, qx, qy, qz; null for the file's own, or the origin"
    )
    added: datetime = Field(description="UTC")
    label: Label | None = Field(None, description="what the cloud shows, if that was said")

    def is_same(self, other: Entry) -> bool:
        """Whether it is the same cloud: its bytes, and how they are read."""
        return _content(self) == _content(other)

    def pose(self) -> Viewpoint | None:
        """The sensor's pose, as the formats take it."""
        return pose_of(self.viewpoint)


class DatasetSummary(BaseModel):
    """A dataset."""

    name: str = Field(pattern=f"^{NAME}$", max_length=63, description="the dataset's name")
    description: str = Field("", max_length=1000, description="what its clouds are")
    created: datetime = Field(description="UTC")


class Dataset(DatasetSummary):
    """A dataset, and what it holds."""

    clouds: int = Field(description="number of clouds")
    bytes: int = Field(description="of the files of all clouds; those that are alike are stored once")
    formats: dict[str, int] = Field(description="clouds of each format")
    categories: dict[str, int] = Field(description="clouds of each category, of those that are labelled")
    digest: str = Field(description="SHA-256 of the keys and contents of all clouds, without the labels")


class Flaw(BaseModel):
    """What is wrong with a cloud."""

    type: str = Field(description="stable, kebab-case name of the error", examples=["too-few-points"])
    detail: str = Field(description="what was wrong, and what to try")


class Verdict(BaseModel):
    """What became of a cloud that was sent."""

    key: str = Field(description="what the cloud is called, or was to be")
    outcome: Outcome = Field(
        description="accepted; replaced: it stands in the place of another one; already-there: nothing was to do; "
        "refused: see the error; left-out: no cloud, such as a picture in an archive"
    )
    sha256: str | None = Field(None, description="of the file's bytes, hexadecimal; null if it was refused or left out")
    error: Flaw | None = Field(None, description="why it was refused or left out")


def refusal(key: str, error: ShapeConceptsError, outcome: Outcome = "refused") -> Verdict:
    """The verdict on a cloud that cannot be taken."""
    return Verdict(key=key, outcome=outcome, error=Flaw(type=error.type_name(), detail=str(error)))


def digest_of(entries: Sequence[Entry]) -> str:
    """SHA-256 of what can be learnt from: keys, contents, and how these are read; equal for equal clouds."""
    said = "".join(
        json.dumps([entry.key, *_content(entry)]) + "\n" for entry in sorted(entries, key=lambda each: each.key)
    )
    return hashlib.sha256(said.encode()).hexdigest()


def numbers_of(pose: Viewpoint | None) -> tuple[float, ...] | None:
    """A pose as it is kept: x, y, z, qw, qx, qy, qz."""
    return None if pose is None else (*pose.position, *pose.orientation)


def pose_of(numbers: tuple[float, ...] | None) -> Viewpoint | None:
    """The pose that was kept so."""
    if numbers is None:
        return None
    x, y, z, *turn = numbers
    return Viewpoint((x, y, z), (turn[0], turn[1], turn[2], turn[3]))


def _content(entry: Entry) -> tuple[object, ...]:
    return (entry.sha256, entry.format, entry.unit, entry.viewpoint)
