"""Reports of made-up stimuli: the tree, the filtration and the concepts are truly those of the stimuli."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from functools import cache
from html.parser import HTMLParser

import numpy as np
from scipy.sparse import csr_array

from service.engine.concepts import concepts_at
from service.engine.params import FiltrationParams
from worker.evaluation.report import (
    Ablated,
    AblatedSet,
    Baseline,
    ConceptPurity,
    Curve,
    Data,
    Figures,
    GroupFigures,
    Grouping,
    Interval,
    Intervals,
    JudgedModel,
    Matrices,
    OtherFigures,
    OtherSet,
    Place,
    RegionGrid,
    Report,
    ResponseMap,
    RivalGrouping,
    Robustness,
    Spread,
    Strength,
    Structure,
    Transfer,
)
from worker.learning.filtration import filtrate
from worker.learning.space import build_space

LABELS = ("box", "can", "plate")


@cache
def structure(size: int = 60, labels: tuple[str | None, ...] = LABELS, seed: int = 0) -> Structure:
    """Of as many prototypes, which bear the labels in turn."""
    rng = np.random.default_rng(seed)
    stimuli = csr_array(np.where(rng.random((size, 12)) < 0.4, rng.random((size, 12)), 0).astype(np.float32))
    space = build_space(stimuli)
    filtration = filtrate(space, FiltrationParams())
    concepts = concepts_at(filtration)
    return Structure(
        keys=[f"objects/{number}.ply" for number in range(size)],
        labels=[labels[number % len(labels)] for number in range(size)],
        heat=space.vertex_heat.tolist(),
        edges=[(a, b) for a, b in space.edges.tolist()],
        divergence=space.distance.tolist(),
        distance=filtration.distance.tolist(),
        time=filtration.time.tolist(),
        annexed=filtration.annexed.tolist(),
        annexing=filtration.annexing.tolist(),
        epsilon_max=filtration.epsilon_max,
        assignment=concepts.assignment.tolist(),
        concepts=concepts.ids.tolist(),
    )


def thumbnails(size: int) -> np.ndarray:
    """Of so many prototypes (size, 48, 48): each a square on the background."""
    images = np.zeros((size, 48, 48), np.uint8)
    for number, image in enumerate(images):
        image[8:40, 8:40] = 80 + number % 170
    return images


def grouping(of: Structure) -> Grouping:
    """The concepts of a labelled structure with the purities that they have."""
    concepts = []
    for place, identity in enumerate(of.concepts):
        members = [label for label, at in zip(of.labels, of.assignment, strict=True) if at == place and label]
        if not members:
            continue
        counts = {label: members.count(label) for label in sorted(set(members))}
        label = max(counts, key=lambda name: counts[name])
        purity = counts[label] / len(members)
        concepts.append(
            ConceptPurity(
                id=identity,
                prototypes=len(members),
                label=label,
                labels=counts,
                purity=purity,
                rank_score=len(members) / (1 - purity + 1e-3),
            )
        )
    figures = group_figures(purity=0.7)
    return Grouping(
        prototypes=len(of.labels),
        covered=0.5,
        purity=float(np.mean([concept.purity for concept in concepts])),
        pure=float(np.mean([concept.purity == 1 for concept in concepts])),
        concepts=sorted(concepts, key=lambda concept: -concept.rank_score),
        figures=figures,
        rivals=[RivalGrouping(vectors="mean FPFH", method="k-means", setting="k = 9", runs=10, figures=figures)],
    )


def group_figures(purity: float) -> GroupFigures:
    shares = {"v_measure": 0.4, "adjusted_rand": -0.1, "v_measure_covered": 0.5, "adjusted_rand_covered": 0.2}
    return GroupFigures(groups=9, covered=0.5, purity=purity, pure=0.25, **shares)


def four(knn: float, svm: float = 0.5, within: float = 0.5, assigned: float = 0.5) -> Figures:
    return Figures(knn=knn, svm=svm, within=within, assigned=assigned)


def interval(value: float, width: float = 0.05) -> Interval:
    return Interval(value=value, low=value - width, high=value + width)


def baseline(figures: Figures, own: Figures, description: str = "a description") -> Baseline:
    leads = {name: interval(getattr(own, name) - getattr(figures, name)) for name in ("knn", "svm")}
    return Baseline(
        description=description,
        dimensions=33,
        figures=figures,
        by_label={},
        intervals=Intervals(knn=interval(figures.knn), svm=interval(figures.svm)),
        ahead=Intervals(**leads),
    )


def response_map(labels: Sequence[str] = LABELS, count: int = 40, cells: int = 6) -> ResponseMap:
    """A map on which clouds and cells bear the labels in turn."""
    places = [
        Place(file=f"{n}.ply", label=labels[n % len(labels)], source="", concept=1, x=n % 7, y=n // 7 % 6)
        for n in range(count)
    ]
    grid = np.arange(cells * cells).reshape(cells, cells)
    regions = RegionGrid(
        low=(0.0, 0.0),
        high=(6.0, 5.0),
        neighbours=4,
        labels=list(labels),
        cells=(grid % len(labels)).tolist(),
        opacity=((grid + 1) / grid.size).tolist(),
    )
    return ResponseMap(seed=0, places=places, regions=regions)


def data(labels: Sequence[str] = LABELS) -> Data:
    return Data(
        labels="scans/labels.csv",
        sha256="0" * 64,
        clouds=44,
        judged=40,
        groups=12,
        categories=dict.fromkeys(labels, 12),
        not_judged={"other": 3},
        unanswered={"empty.ply": "it holds no points"},
    )


def bare_report(labels: Sequence[str] = LABELS) -> Report:
    """What every report has, and nothing else."""
    own = four(0.8, 0.7, 0.6, 0.5)
    count = len(labels)
    return Report(
        command="shape-concepts-worker evaluate",
        model=JudgedModel(name="toys", version=3, sha256="0" * 64, concepts=9, responses=9, time=0.5),
        data=data(labels),
        protocol={"knn": "how it is made"},
        figures=own,
        by_label=dict.fromkeys(labels, own),
        by_source={},
        matrices=Matrices(
            labels=list(labels), within=np.eye(count).tolist(), assigned=np.full((count, count), 1 / count).tolist()
        ),
        grouping=None,
    )


def whole_report(size: int = 60, labels: tuple[str, ...] = LABELS) -> Report:
    """A report with everything that one can have."""
    bare, spread = bare_report(labels), Spread(mean=0.6, deviation=0.05, low=0.5, high=0.7)
    recalls = Intervals(knn=interval(0.7), svm=interval(0.6))
    of = structure(size, labels)
    left = AblatedSet(name="scans/labels.csv", intervals=recalls, ahead=recalls)
    curve = Curve(
        name="scaled",
        description="all coordinates times a factor",
        unit="",
        strengths=[Strength(strength=s, kept=0.9, in_use=8, refused=0) for s in (0.3, 1, 3)],
    )
    return bare.model_copy(
        update={
            "intervals": Intervals(knn=interval(0.8), svm=interval(0.7)),
            "ablation": [Ablated(name="unions alone", levels=[2, 3], vertices=70, concepts=4, sets=[left, left])],
            "baselines": {"mean FPFH": baseline(four(0.9), bare.figures), "ESF": baseline(four(0.6), bare.figures)},
            "map": response_map(labels),
            "structure": of,
            "grouping": grouping(of),
            "transfer": Transfer(draws=9, recall=spread, by_label={labels[0]: spread}, rivals={"responses": spread}),
            "others": [
                OtherSet(
                    data=data(labels),
                    model=OtherFigures(intervals=recalls, by_label={labels[0]: {"knn": 0.5, "svm": 0.4}}),
                    baselines={"mean FPFH": OtherFigures(intervals=recalls, by_label={})},
                )
            ],
            "robustness": Robustness(clouds=40, in_use=8, curves=[curve]),
        }
    )


class Page(HTMLParser):
    """What a page consists of.

    Attributes:
        tags: each start tag with its attributes.
        text: all text outside of style.
        open_tags: what was not closed.
    """

    EMPTY = frozenset({"meta", "img", "br", "hr", "link", "input"})

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.open_tags: list[str] = []
        self.wrongly_closed: list[str] = []
        self.feed(html)
        self.close()

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attributes)))
        if tag not in self.EMPTY:
            self.open_tags.append(tag)

    def handle_startendtag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attributes)))

    def handle_endtag(self, tag: str) -> None:
        if self.open_tags and self.open_tags[-1] == tag:
            self.open_tags.pop()
        else:
            self.wrongly_closed.append(tag)

    def handle_data(self, data: str) -> None:
        if "style" not in self.open_tags:
            self.text += data

    def values(self, name: str) -> list[str]:
        """Of an attribute, wherever it is given."""
        return [value for _, attributes in self.tags if (value := attributes.get(name)) is not None]


def group(svg: str, key: str) -> list[ElementTree.Element]:
    """The paths of a picture's group of that name; none where it has no such group."""
    found = [element for element in ElementTree.fromstring(svg).iter() if element.get("id") == key]
    return [path for element in found for path in element.iter() if path.tag.endswith("path")]


def colours_in(svg: str) -> set[str]:
    """All colours that a picture names, hexadecimal."""
    return set(re.findall(r"#[0-9a-f]{6}\b", svg))
