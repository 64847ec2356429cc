"""The report of an evaluation, as one JSON file that is there whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

FILE = "report.json"


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True)


class JudgedModel(_Part):
    """The model that was judged."""

    name: str = Field(description="its name")
    version: int = Field(description="its version")
    sha256: str = Field(description="of its tensors")
    concepts: int = Field(description="concepts at the filtration time")
    time: float = Field(description="filtration time, in [0, 1]")


class Data(_Part):
    """The clouds by which it was judged."""

    labels: str = Field(description="the labels' file, as it was given")
    sha256: str = Field(description="of that file")
    clouds: int = Field(description="rows of that file")
    judged: int = Field(description="clouds that the figures are made of")
    groups: int = Field(description="groups among those")
    categories: dict[str, int] = Field(description="clouds of each category judged")
    not_judged: dict[str, int] = Field(description="answered clouds of categories that are too small, or none")
    unanswered: dict[str, str] = Field(description="clouds that the model refused, and why; they are in no figure")


class Figures(_Part):
    """How well responses tell labels apart; 1 is best."""

    knn: float = Field(description="nearest neighbour")
    svm: float = Field(description="support vector machine")
    within: float = Field(description="share of a region's instances that bear its label")
    assigned: float = Field(description="share of a label's instances that lie in its regions")


class SourceFigures(_Part):
    """The figures of one source's clouds, with those of all sources to learn from."""

    clouds: int = Field(description="clouds judged")
    knn: float = Field(description="nearest neighbour")
    svm: float = Field(description="support vector machine")


class Matrices(_Part):
    """Labels and regions of the map; a row each and a column each."""

    labels: list[str] = Field(description="of the rows and of the columns")
    within: list[list[float]] = Field(description="of a region's instances (row), the share of each label (column)")
    assigned: list[list[float]] = Field(description="of a label's instances (row), the share in each region (column)")


class ConceptPurity(_Part):
    """A concept whose prototypes are labelled."""

    id: int = Field(description="of the concept")
    prototypes: int = Field(description="how many it has that are labelled")
    label: str | None = Field(description="of most of them")
    purity: float = Field(description="pu(c), Eq. 5")
    rank_score: float = Field(description="rs(c), Eq. 6")


class Grouping(_Part):
    """How concepts and labels go together, where the model was trained on clouds that are labelled."""

    prototypes: int = Field(description="prototypes that are labelled")
    covered: float = Field(description="share of them that belong to a concept")
    purity: float = Field(description="mean purity of the concepts, Eq. 5")
    pure: float = Field(description="share of the concepts with a purity of 1")
    concepts: list[ConceptPurity] = Field(description="by descending rank score, Eq. 6")


class Report(_Part):
    """How good a model's concepts are, and how that was found."""

    command: str = Field(description="what was called")
    model: JudgedModel
    data: Data
    protocol: dict[str, str] = Field(description="how each figure is made")
    figures: Figures = Field(description="means over labels")
    by_label: dict[str, Figures] = Field(description="the same figures of each label")
    by_source: dict[str, SourceFigures] = Field(description="figures of each source's clouds")
    matrices: Matrices
    grouping: Grouping | None = Field(description="null where no prototype of the model is labelled")


def write_report(report: Report, folder: Path) -> Path:
    """Writes `report.json` into a folder, which is made if need be; returns the file."""
    folder.mkdir(parents=True, exist_ok=True)
    file, unfinished = folder / FILE, folder / f".{FILE}.{os.getpid()}"
    try:
        unfinished.write_text(report.model_dump_json(indent=2) + "\n", encoding="utf-8")
        unfinished.replace(file)
    finally:
        unfinished.unlink(missing_ok=True)
    return file
