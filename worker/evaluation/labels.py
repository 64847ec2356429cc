"""Labelled clouds: the file `labels.csv` and which of its clouds are judged."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from service.engine.errors import InvalidParameter

OTHER = "other"  # what is none of the categories; such clouds are not judged
LEAST = 6  # clouds that a category must have to be judged
NEEDED = ("file", "category")


class LabelledCloud(NamedTuple):
    """A row of `labels.csv`.

    Attributes:
        file: of the cloud, as the row has it.
        path: where that is.
        category: the label.
        group: clouds of one group never stand on both sides of a split; the file itself where none is given.
        source: where the cloud comes from, empty where that is not given.
    """

    file: str
    path: Path
    category: str
    group: str
    source: str


def read_labels(table: Path) -> list[LabelledCloud]:
    """Reads `labels.csv`, with the columns `file`, relative to it, `category`, and optionally `group` and `source`.

    Raises:
        InvalidParameter: the file cannot be read or lacks a column, a row has no label, or a cloud is not there or
            named twice.
    """
    try:
        with table.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file)
            columns, rows = reader.fieldnames or [], list(reader)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise InvalidParameter(f"The labels {table} cannot be read: {reason}.") from error
    if missing := [column for column in NEEDED if column not in columns]:
        raise InvalidParameter(
            f"The labels {table} have no column {' and no column '.join(missing)}: "
            f"the first line names {', '.join(columns) or 'nothing'}."
        )
    clouds = [_labelled(table, row) for row in rows]
    if unlabelled := [cloud.file for cloud in clouds if not cloud.file or not cloud.category]:
        raise InvalidParameter(f"{len(unlabelled)} rows of {table} lack a file or a category{_first(unlabelled)}.")
    if twice := [file for file, count in Counter(cloud.file for cloud in clouds).items() if count > 1]:
        raise InvalidParameter(f"{len(twice)} clouds are named twice in {table}{_first(twice)}.")
    if absent := [cloud.file for cloud in clouds if not cloud.path.is_file()]:
        raise InvalidParameter(
            f"{len(absent)} of the {len(clouds)} clouds of {table} are not beside it{_first(absent)}."
        )
    return clouds


def judged(clouds: Sequence[LabelledCloud]) -> list[int]:
    """Places of the clouds that are judged: those of `judged_categories`.

    Raises:
        InvalidParameter: there are not two such categories.
    """
    large = judged_categories(cloud.category for cloud in clouds)
    return [place for place, cloud in enumerate(clouds) if cloud.category in large]


def judged_categories(labels: Iterable[str]) -> set[str]:
    """The categories that at least 6 clouds have, from the category of each cloud.

    Raises:
        InvalidParameter: there are not two such categories.
    """
    counts = Counter(label for label in labels if label != OTHER)
    large = {category for category, count in counts.items() if count >= LEAST}
    if len(large) < 2:
        known = ", ".join(f"{category} {count}" for category, count in counts.most_common()) or "none"
        raise InvalidParameter(
            f"To judge needs two categories of at least {LEAST} clouds each; the clouds of each are: {known}."
        )
    return large


def _labelled(table: Path, row: dict[str, str | None]) -> LabelledCloud:
    file = (row["file"] or "").strip()
    return LabelledCloud(
        file=file,
        path=table.parent / file,
        category=(row["category"] or "").strip(),
        group=(row.get("group") or "").strip() or f"file {file}",
        source=(row.get("source") or "").strip(),
    )


def _first(files: Sequence[str]) -> str:
    return f", the first is '{files[0]}'" if files[0] else ""
