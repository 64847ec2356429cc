"""Visual words: the hierarchical dictionary D, whose level f holds 2^f words (Sec. Object Segment Extraction)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Dictionary:
    """The visual words of each description level.

    Attributes:
        levels: level f, counted from 1, is `levels[f - 1]`, a (2^f, D) float32 array of description vectors.
    """

    levels: tuple[NDArray[np.float32], ...]

    def words(self, descriptors: NDArray[np.float32]) -> NDArray[np.int64]:
        """The nearest visual word by L2 of every segment on every level; of equally near ones the first.

        Args:
            descriptors: (S, D).

        Returns:
            (S, n) int64, a column a level.
        """
        columns = []
        for level in self.levels:
            difference = descriptors[:, None, :].astype(np.float64) - level[None].astype(np.float64)
            columns.append(np.einsum("swd,swd->sw", difference, difference).argmin(axis=1))
        return np.stack(columns, axis=1)
