"""Vectors that another program made of the same clouds, to be judged beside the model: CSV, `path,v1,v2,...`."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path, PurePath

import numpy as np
from numpy.typing import NDArray

from service.engine.errors import InvalidParameter


@dataclass(frozen=True)
class VectorFile:
    """Vectors of clouds, known by the names of their files without folder and ending.

    Attributes:
        name: what the baseline is called.
        file: where the vectors stand.
        vectors: of each cloud's name, all of one length.
    """

    name: str
    file: Path
    vectors: dict[str, NDArray[np.float64]]

    def has(self, files: Iterable[str]) -> bool:
        """Whether there is a vector of each of these clouds."""
        return all(stem(file) in self.vectors for file in files)

    def of(self, files: Iterable[str]) -> NDArray[np.float64]:
        """The vectors of clouds (n, D), in their order.

        Raises:
            InvalidParameter: some have none, or one that another cloud of the same name has as well.
        """
        wanted = [stem(file) for file in files]
        if missing := [name for name in wanted if name not in self.vectors]:
            raise InvalidParameter(
                f"The vectors {self.file} lack {len(missing)} of the {len(wanted)} clouds, the first is "
                f"'{missing[0]}'. Clouds are known by the names of their files, without folder and ending."
            )
        if len(set(wanted)) < len(wanted):
            twice = next(name for name in wanted if wanted.count(name) > 1)
            raise InvalidParameter(
                f"Several clouds are called '{twice}': the vectors {self.file} cannot tell them apart."
            )
        return np.stack([self.vectors[name] for name in wanted])


def stem(file: str) -> str:
    """The name of a cloud's file without its folder and its ending."""
    return PurePath(file).stem


def read_vector_file(name: str, file: Path) -> VectorFile:
    """Reads one vector a line: the path of the cloud, and the numbers.

    Raises:
        InvalidParameter: the file cannot be read, holds no vectors of one length, or a cloud twice.
    """
    try:
        with file.open(encoding="utf-8", newline="") as lines:
            rows = [row for row in csv.reader(lines) if row]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise InvalidParameter(f"The vectors {file} cannot be read: {reason}.") from error
    if len(lengths := {len(row) - 1 for row in rows}) != 1 or min(lengths) < 2:
        raise InvalidParameter(
            f"The vectors {file} have lengths of {', '.join(map(str, sorted(lengths))) or 'nothing'}: each line is a "
            "path and at least two numbers, as many on each line."
        )
    try:
        numbers = np.array([row[1:] for row in rows], dtype=np.float64)
    except ValueError as error:
        raise InvalidParameter(f"The vectors {file} hold something that is no number: {error}.") from error
    if not np.isfinite(numbers).all():
        raise InvalidParameter(f"The vectors {file} hold infinite numbers, or none where one should be.")
    names = [stem(row[0]) for row in rows]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InvalidParameter(f"The vectors {file} name the cloud '{twice}' twice.")
    return VectorFile(name, file, dict(zip(names, numbers, strict=True)))
