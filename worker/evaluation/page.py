"""The report as a page for people: report.html, which needs no other file, no network and no script."""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from numpy.typing import NDArray

from service.engine.model import ShapeModel
from worker.evaluation.figures.ablation import ablation_figure
from worker.evaluation.figures.annexation import annexation_figure
from worker.evaluation.figures.baselines import baseline_figure, label_table, other_figure, source_table
from worker.evaluation.figures.concepts import concept_figure, ranked_figure
from worker.evaluation.figures.figure import Figure, Table
from worker.evaluation.figures.filtration import filtration_figure
from worker.evaluation.figures.grouping import grouping_figure
from worker.evaluation.figures.palette import Palette, palette_of
from worker.evaluation.figures.regions import map_figure, matrix_figure
from worker.evaluation.figures.robustness import robustness_figure
from worker.evaluation.figures.space import space_figure
from worker.evaluation.figures.transfer import transfer_figure
from worker.evaluation.headline import headlines, summary
from worker.evaluation.report import Report

FILE = "report.html"
TEMPLATE = "report.html.jinja"


class Section(NamedTuple):
    """A part of the page: its address, its title, its figures, and the tables after them."""

    key: str
    title: str
    figures: tuple[Figure, ...]
    tables: tuple[Table, ...] = ()


def write_page(report: Report, model: ShapeModel, folder: Path) -> Path:
    """Writes `report.html` into a folder, which is made if need be, whole or not at all; returns the file."""
    text = render(report, model.prototypes.thumbnails, model.embedded_prototypes)
    folder.mkdir(parents=True, exist_ok=True)
    file, unfinished = folder / FILE, folder / f".{FILE}.{os.getpid()}"
    try:
        unfinished.write_text(text, encoding="utf-8", errors="replace")  # a file's name may be no text
        unfinished.replace(file)
    finally:
        unfinished.unlink(missing_ok=True)
    return file


def render(report: Report, thumbnails: NDArray[np.uint8], embedded: NDArray[np.float64]) -> str:
    """The page: one report of one model gives one page, byte for byte.

    Args:
        report: of the model.
        thumbnails: (N, 48, 48) of its prototypes; 0 is background.
        embedded: (N, k): its prototypes in the metric's coordinates.
    """
    loader = FileSystemLoader(Path(__file__).with_name("templates"))
    page = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    return page.get_template(TEMPLATE).render(
        report=report,
        summary=summary(report),
        headlines=headlines(report),
        sections=[section for section in _sections(report, thumbnails, embedded) if section.figures],
    )


def _sections(report: Report, thumbnails: NDArray[np.uint8], embedded: NDArray[np.float64]) -> tuple[Section, ...]:
    palette = palette_of(report)
    return (
        Section("labels", "How well labels can be told", (baseline_figure(report),), _tables(report)),
        Section("parts", "What the parts pay", (ablation_figure(report),) if report.ablation else ()),
        Section("regions", "The map of responses", _map(report, palette)),
        Section("learnt", "What was learnt", _learnt(report, thumbnails, embedded, palette)),
        Section("beyond", "One example, other clouds, disturbed clouds", _beyond(report)),
    )


def _tables(report: Report) -> tuple[Table, ...]:
    return (label_table(report), *([source_table(report)] if report.by_source else []))


def _map(report: Report, palette: Palette) -> tuple[Figure, ...]:
    mapped = [map_figure(report.map, palette)] if report.map else []
    return (*mapped, matrix_figure(report.matrices, report.figures))


def _learnt(
    report: Report, thumbnails: NDArray[np.uint8], embedded: NDArray[np.float64], palette: Palette
) -> tuple[Figure, ...]:
    structure, figures = report.structure, []
    if structure is not None:
        figures += [
            space_figure(structure, palette),
            annexation_figure(structure, palette),
            filtration_figure(structure),
            concept_figure(structure, thumbnails, embedded, palette),
        ]
    ranked = ranked_figure(structure, report.grouping, palette)
    grouped = grouping_figure(report.grouping) if report.grouping else None
    return (*figures, *(figure for figure in (ranked, grouped) if figure is not None))


def _beyond(report: Report) -> tuple[Figure, ...]:
    return (
        *([transfer_figure(report.transfer)] if report.transfer else []),
        *(other_figure(other, place) for place, other in enumerate(report.others)),
        *([robustness_figure(report.robustness)] if report.robustness else []),
    )
