"""Labels of clouds: what people say that they show, apart from the clouds, which are learnt from without them."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from service.clouds.claims import quote
from service.engine.errors import InvalidParameter

FILE = "labels.csv"
NEEDED = ("file", "category")
MEDIA_TYPE = "text/csv"


class Label(BaseModel):
    """What a cloud shows; all but the category may be left empty."""

    model_config = ConfigDict(frozen=True, extra="forbid", str_strip_whitespace=True)

    category: str = Field(min_length=1, max_length=200, description="kind of object", examples=["mug"])
    fine: str = Field("", max_length=200, description="kind of object, finer")
    instance: str = Field("", max_length=200, description="the very object")
    view: str = Field("", max_length=200, description="scene or viewpoint in which it was seen")
    source: str = Field("", max_length=500, description="where the cloud comes from")
    group: str = Field("", max_length=500, description="clouds of one group never stand in both halves of a split")


COLUMNS = ("file", *Label.model_fields)


class Labelled(NamedTuple):
    """A row of `labels.csv`.

    Attributes:
        file: of the cloud, as the row has it: a path relative to the table.
        label: of the cloud.
    """

    file: str
    label: Label


def read_labels(data: bytes) -> list[Labelled]:
    """Reads `labels.csv`: the columns `file` and `category`, and optionally those of the other fields of `Label`.

    Raises:
        InvalidParameter: it is no such table, a row lacks a file or category, or a file is named twice.
    """
    try:
        reader = csv.DictReader(io.StringIO(data.decode("utf-8-sig"), newline=""), strict=True)
        columns, rows = reader.fieldnames or [], list(reader)
    except (UnicodeDecodeError, csv.Error) as error:
        raise InvalidParameter(f"The labels are no table of comma-separated values in UTF-8: {error}.") from error
    if missing := [column for column in NEEDED if column not in columns]:
        raise InvalidParameter(
            f"The labels have no column {' and no column '.join(missing)}: the first line is {quote(columns, 200)}."
        )
    labelled = [_row(number, row) for number, row in enumerate(rows, start=2)]
    if twice := [file for file, count in Counter(row.file for row in labelled).items() if count > 1]:
        raise InvalidParameter(f"{len(twice)} clouds are named twice in the labels, the first is {quote(twice[0])}.")
    return labelled


def write_labels(labelled: Iterable[Labelled]) -> bytes:
    """Writes `labels.csv` with all columns."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for file, label in labelled:
        writer.writerow((file, *label.model_dump().values()))
    return text.getvalue().encode()


def _row(number: int, row: dict[str, str | None]) -> Labelled:
    file = (row.get("file") or "").strip()
    given = {name: row.get(name) or "" for name in Label.model_fields}
    try:
        if file:
            return Labelled(file, Label.model_validate(given))
        said = "it names no file"
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        said = f"{first['loc'][0]}: {first['msg']}"
    raise InvalidParameter(f"Row {number} of the labels cannot be used: {said}.")
