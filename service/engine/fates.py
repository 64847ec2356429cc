"""What becomes of sets of objects: which persist, merge, split, and which disappear.

Let |a| be how many objects an old concept a has, and |a & b| how many it shares with the new concept b. Concepts of one
time have no object in common, so that more than half of a can lie in one b only. a

- persists as b where J(a, b) = |a & b| / |a | b| > 1/2: each has at most one such partner, and with less a cluster
  counts as dissolved (Hennig, "Dissolution point and isolation robustness", J. Multivariate Analysis 99, 2008);
- else merges into b where |a & b| > |a| / 2: most of it lies in a concept that has much else;
- else splits into all b with |a & b| > |b| / 2, where these together have more than half of a;
- else disappears.

The fate of a new concept is that of an old one with the versions exchanged, told the other way round: it persists, was
split off, was merged, or appears. Numbers and order of objects and concepts play no part. Fates in terms of overlaps
are those of Spiliopoulou et al., "MONIC: Modeling and Monitoring Cluster Transitions", KDD 2006; the thresholds there
are parameters.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

Fate = Literal["persists", "merges", "splits", "disappears", "untold"]
PERSISTS = 0.5  # J above which two concepts are one


class Overlap(NamedTuple):
    """What a concept has in common with one of the other version.

    Attributes:
        concept: its place among the other version's.
        objects: how many objects they share.
        jaccard: that, over the objects of either, (0, 1].
    """

    concept: int
    objects: float
    jaccard: float


class Change(NamedTuple):
    """What became of a concept.

    Attributes:
        fate: in the direction from its version to the other; "untold" where it has none of the common objects.
        objects: how many of the common objects it has.
        overlaps: concepts of the other version that hold more than half of it, or of which it holds more than half, or
            as which it persists: most objects first.
    """

    fate: Fate
    objects: float
    overlaps: tuple[Overlap, ...]


class Shares(NamedTuple):
    """Which concepts of two versions have objects in common, and how many (P pairs).

    Attributes:
        pairs: (P, 2) int64: places of the old and of the new concept, in lexicographic order.
        shared: (P,) float64: objects in common, more than none.
        sizes: (P, 2) float64: objects of either.
        old: (A,) float64: objects of each old concept.
        new: (B,) float64: objects of each new concept.
    """

    pairs: NDArray[np.int64]
    shared: NDArray[np.float64]
    sizes: NDArray[np.float64]
    old: NDArray[np.float64]
    new: NDArray[np.float64]

    @property
    def jaccard(self) -> NDArray[np.float64]:
        """(P,): the objects in common over those of either, (0, 1]."""
        return np.asarray(self.shared / (self.sizes.sum(axis=1) - self.shared))


def share(old: csr_array, new: csr_array, weight: NDArray[np.float64]) -> Shares:
    """What concepts have in common.

    Args:
        old: (A, U) sparse: 1 where an object belongs to a concept.
        new: (B, U) sparse, of the same objects.
        weight: (U,) how many objects each counts as.
    """
    counted = csr_array(old.multiply(weight[None])).astype(np.float64)
    common = csr_array(counted @ new.T).tocoo()
    row, column = (axis.astype(np.int64) for axis in common.coords)
    order = np.lexsort((column, row))
    pairs = np.stack([row[order], column[order]], axis=1)
    of_old, of_new = np.asarray(old @ weight), np.asarray(new @ weight)
    sizes = np.stack([of_old[pairs[:, 0]], of_new[pairs[:, 1]]], axis=1)
    return Shares(pairs, common.data[order], sizes, of_old, of_new)


def changes(shares: Shares) -> tuple[Change, ...]:
    """What becomes of each old concept, by the rule above; concepts of one version have no object in common."""
    jaccard = shares.jaccard
    mostly_in, mostly_of = (2 * shares.shared[:, None] > shares.sizes).T
    start = np.searchsorted(shares.pairs[:, 0], np.arange(len(shares.old) + 1))
    return tuple(
        _change(shares, jaccard, mostly_in, mostly_of, range(start[a], start[a + 1]), float(size))
        for a, size in enumerate(shares.old)
    )


def counterparts(shares: Shares) -> dict[int, Overlap]:
    """The new concept that each old one is, where concepts of one version may lie within each other.

    They are each other's most alike by J, and J > 1/2. Of equally alike ones the first is taken.

    Returns:
        By the old concept's place; it is missing where there is none.
    """
    jaccard = shares.jaccard
    best_of_old, best_of_new = (_best(shares.pairs[:, side], jaccard) for side in (0, 1))
    return {
        a: Overlap(int(shares.pairs[row, 1]), float(shares.shared[row]), float(jaccard[row]))
        for a, row in best_of_old.items()
        if best_of_new[int(shares.pairs[row, 1])] == row and jaccard[row] > PERSISTS
    }


def _change(
    shares: Shares,
    jaccard: NDArray[np.float64],
    mostly_in: NDArray[np.bool_],
    mostly_of: NDArray[np.bool_],
    rows: range,
    size: float,
) -> Change:
    """What becomes of the concept whose pairs stand in some rows."""
    own = np.arange(rows.start, rows.stop)
    linked = own[mostly_in[own] | mostly_of[own]]
    overlaps = sorted(
        (Overlap(int(shares.pairs[row, 1]), float(shares.shared[row]), float(jaccard[row])) for row in linked),
        key=lambda overlap: (-overlap.objects, overlap.concept),
    )
    fate: Fate = "disappears"
    if size == 0:
        fate = "untold"
    elif (jaccard[own] > PERSISTS).any():
        fate = "persists"
    elif mostly_in[own].any():
        fate = "merges"
    elif 2 * shares.shared[own[mostly_of[own]]].sum() > size:
        fate = "splits"
    return Change(fate, size, tuple(overlaps))


def _best(concepts: NDArray[np.int64], jaccard: NDArray[np.float64]) -> dict[int, int]:
    """The row of the highest J of each concept, of equal ones the first."""
    best: dict[int, int] = {}
    for row in np.lexsort((np.arange(len(jaccard)), -jaccard)).tolist():
        best.setdefault(int(concepts[row]), row)
    return best
