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
    responses: int = Field(description="concepts that it answers with: those, and specific and generic ones")
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
    """How well vectors tell labels apart; 1 is best."""

    knn: float = Field(description="nearest neighbour")
    svm: float = Field(description="support vector machine")
    within: float = Field(description="share of a region's instances that bear its label")
    assigned: float = Field(description="share of a label's instances that lie in its regions")


class SourceFigures(_Part):
    """The figures of one source's clouds, with those of all sources to learn from."""

    clouds: int = Field(description="clouds judged")
    knn: float = Field(description="nearest neighbour")
    svm: float = Field(description="support vector machine")


class Interval(_Part):
    """A figure and its 95 % bootstrap interval: groups of clouds are drawn anew, not clouds."""

    value: float = Field(description="the figure")
    low: float = Field(description="its 2.5 % quantile")
    high: float = Field(description="its 97.5 % quantile")


class Intervals(_Part):
    """Mean recalls, or differences of them, with their intervals."""

    knn: Interval = Field(description="nearest neighbour")
    svm: Interval = Field(description="support vector machine")


class Matrices(_Part):
    """Labels and regions of the map; a row each and a column each."""

    labels: list[str] = Field(description="of the rows and of the columns")
    within: list[list[float]] = Field(description="of a region's instances (row), the share of each label (column)")
    assigned: list[list[float]] = Field(description="of a label's instances (row), the share in each region (column)")


class Place(_Part):
    """Where a judged cloud lies in the map CR^2."""

    file: str = Field(description="of the cloud, as the labels' file has it")
    label: str
    source: str = Field(description="where the cloud comes from, empty where that is not known")
    concept: int = Field(description="id of the concept that it resembles most")
    x: float
    y: float


class RegionGrid(_Part):
    """The regions of the map: square cells, the first row at the lowest y, the first column at the lowest x."""

    low: tuple[float, float] = Field(description="lowest x and y, the outer corner of the first cell")
    high: tuple[float, float] = Field(description="highest x and y, the outer corner of the last cell")
    neighbours: int = Field(description="k, how many of the nearest instances vote on a cell's label: 5 % of them")
    labels: list[str] = Field(description="that cells can have, sorted")
    cells: list[list[int]] = Field(description="of each row (y) and column (x), the place of the label in `labels`")
    opacity: list[list[float]] = Field(description="of each cell, the share of the k nearest that bear its label")


class ResponseMap(_Part):
    """The map CR^2: the judged clouds' standardised responses in the plane, by t-SNE, and its regions."""

    seed: int = Field(description="of the t-SNE; the first of those that `within` and `assigned` are the mean over")
    places: list[Place]
    regions: RegionGrid


class Baseline(_Part):
    """Vectors of whole clouds, judged beside the model's responses and as they are."""

    description: str = Field(description="what it is")
    dimensions: int = Field(description="of a vector")
    figures: Figures = Field(description="means over labels")
    by_label: dict[str, Figures] = Field(description="the same figures of each label")
    intervals: Intervals
    ahead: Intervals = Field(description="how far the model is ahead of it: differences, paired over the same clouds")


class GroupFigures(_Part):
    """How groups of prototypes and labels go together; 'other' agrees with no label, not even with 'other'."""

    groups: int = Field(description="groups with a labelled prototype")
    covered: float = Field(description="share of the labelled prototypes that belong to a group")
    purity: float = Field(description="mean purity of the groups, Eq. 5")
    pure: float = Field(description="share of the groups with a purity of 1")
    v_measure: float = Field(description="over all labelled prototypes; each that is not covered is a group of its own")
    adjusted_rand: float = Field(description="over the same")
    v_measure_covered: float = Field(description="over the prototypes that the model's concepts cover")
    adjusted_rand_covered: float = Field(description="over the same")


class RivalGrouping(_Part):
    """A clustering of whole-cloud vectors, into as many groups as there are concepts or as near as it comes."""

    vectors: str = Field(description="name of the baseline whose vectors were clustered")
    method: str = Field(description="'k-means', or 'HDBSCAN'")
    setting: str = Field(description="what was set so that the number of groups is that of the concepts")
    runs: int = Field(description="with different seeds, over which the figures are means")
    figures: GroupFigures


class ConceptPurity(_Part):
    """A concept whose prototypes are labelled."""

    id: int = Field(description="of the concept")
    prototypes: int = Field(description="how many it has that are labelled")
    label: str | None = Field(description="of most of them")
    labels: dict[str, int] = Field(default={}, description="how many bear each label, 'other' too")
    purity: float = Field(description="pu(c), Eq. 5")
    rank_score: float = Field(description="rs(c), Eq. 6")


class Grouping(_Part):
    """How concepts and labels go together, where the model was trained on clouds that are labelled."""

    prototypes: int = Field(description="prototypes that are labelled")
    covered: float = Field(description="share of them that belong to a concept")
    purity: float = Field(description="mean purity of the concepts, Eq. 5")
    pure: float = Field(description="share of the concepts with a purity of 1")
    concepts: list[ConceptPurity] = Field(description="by descending rank score, Eq. 6")
    figures: GroupFigures | None = Field(default=None, description="of the concepts, to compare with those of rivals")
    rivals: list[RivalGrouping] = Field(default=[], description="clusterings of the baselines' vectors")


class Structure(_Part):
    """The model's topological space X and its filtration F; what trees, graphs, barcodes and annexations show.

    N prototypes are vertices 0 to N - 1; the N - 1 edges of the tree are rows, and the annexations in the same order.
    """

    keys: list[str] = Field(description="of each prototype's cloud")
    labels: list[str | None] = Field(description="of each prototype; null where it is not among the labelled clouds")
    heat: list[float] = Field(description="of each vertex: mean geodesic distance, Eq. 3")
    edges: list[tuple[int, int]] = Field(description="of the minimum spanning tree, the smaller vertex first")
    divergence: list[float] = Field(description="of each edge: JSD of its two stimuli vectors, nats")
    distance: list[float] = Field(description="of each edge: the edge heat, scaled and inverted")
    time: list[float] = Field(description="of each edge: annexation time in [0, 1]; the deaths of the barcode")
    annexed: list[int] = Field(description="of each edge: representative of the component that dies")
    annexing: list[int] = Field(description="of each edge: representative of the component that sustains")
    epsilon_max: float = Field(
        description="middle of the stretch of time of most annexations, at which concepts are taken"
    )
    assignment: list[int] = Field(description="of each prototype: place of its concept in `concepts`, -1 for none")
    concepts: list[int] = Field(description="ids of the concepts, largest first")


class Spread(_Part):
    """A mean over random draws, and how the draws differ."""

    mean: float
    deviation: float = Field(description="standard deviation over the draws")
    low: float = Field(description="2.5 % quantile of the draws")
    high: float = Field(description="97.5 % quantile of the draws")


class Transfer(_Part):
    """One instance a label: the label whose motif prototypes accumulate the highest stimulus wins."""

    draws: int = Field(description="random choices of the one instance a label")
    recall: Spread = Field(description="mean recall over labels")
    by_label: dict[str, Spread] = Field(description="recall of each label; without those never asked for")
    rivals: dict[str, Spread] = Field(
        description="mean recall of the same draws where the nearest vector wins instead: 'responses', and baselines"
    )


class OtherFigures(_Part):
    """Mean recalls of another set's clouds, judged by those of the first."""

    intervals: Intervals
    by_label: dict[str, dict[str, float]] = Field(description="of each label, the recall by 'knn' and by 'svm'")
    ahead: Intervals | None = Field(default=None, description="of a baseline: how far the model is ahead of it")


class OtherSet(_Part):
    """Another set of labelled clouds, judged by the first: clouds of a group never judge one another."""

    data: Data
    model: OtherFigures
    baselines: dict[str, OtherFigures]


class AblatedSet(_Part):
    """How well a set's labels are told by what is left of a model; the first set judges all."""

    name: str = Field(description="the set's labels' file")
    intervals: Intervals
    ahead: Intervals = Field(description="how far the whole model is ahead of what is left of it")


class Ablated(_Part):
    """What is left of a model when it is learnt anew from some motif levels alone."""

    name: str = Field(description="what is left of the hierarchies")
    levels: list[int] = Field(description="the motif levels that are left")
    vertices: int = Field(description="motif vertices on those levels")
    concepts: int = Field(description="concepts at its own epsilon_max")
    sets: list[AblatedSet] = Field(description="the judged set first, then the other sets in their order")


class Strength(_Part):
    """What becomes of the best concepts at one strength of a disturbance."""

    strength: float
    kept: float = Field(description="share of the clouds whose best concept stays; one that is refused loses it")
    in_use: int = Field(description="concepts that are the best one of at least one cloud")
    refused: int = Field(description="clouds that the model refuses at this strength")


class Curve(_Part):
    """A disturbance of clouds, at growing strengths."""

    name: str = Field(description="short, of the disturbance")
    description: str = Field(description="what is done to a cloud")
    unit: str = Field(description="of the strength; empty for a plain factor")
    strengths: list[Strength]


class Robustness(_Part):
    """What becomes of the best concept when the clouds are disturbed."""

    clouds: int = Field(description="that were disturbed: all that the model answers, whatever their label")
    in_use: int = Field(description="concepts that are the best one of at least one undisturbed cloud")
    curves: list[Curve]


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
    intervals: Intervals | None = Field(default=None, description="of the figures that are mean recalls")
    map: ResponseMap | None = Field(default=None, description="of the judged clouds' responses")
    baselines: dict[str, Baseline] = Field(default={}, description="other vectors, judged by the same protocol")
    grouping: Grouping | None = Field(description="null where no prototype of the model is labelled")
    structure: Structure | None = Field(default=None, description="of the model")
    transfer: Transfer | None = Field(default=None, description="one instance a label")
    others: list[OtherSet] = Field(default=[], description="other sets of clouds, judged by this one")
    ablation: list[Ablated] = Field(default=[], description="the model with motif levels taken away, arm by arm")
    robustness: Robustness | None = Field(default=None, description="null where it was not asked for")


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
