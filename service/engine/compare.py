"""Two versions of a model: which concepts persist, merge, split, appear and disappear.

Concepts are sets of prototypes, so two versions are compared by the objects that both can tell the concepts of. These
are all clouds that either has learnt from, each by the hash of its points. An object that a model learnt from is its
own prototype; of any other one the model is asked, by what the other model recalls of it, which of its prototypes is
the nearest (`recall.place`), or none where the object is novel to it. So every concept, of either version and of any
filtration time, is a set of the same objects. Numbers and order of prototypes and concepts play no part.

Let |a| be how many objects an old concept a has, and |a & b| how many it shares with the new concept b. Concepts of one
time have no object in common, so what more than half of a shares with b, it shares with no other. a

- persists as b where J(a, b) = |a & b| / |a | b| > 1/2: each has at most one such partner, and with less a cluster
  counts as dissolved (Hennig, "Dissolution point and isolation robustness", J. Multivariate Analysis 99, 2008);
- else merges into b where |a & b| > |a| / 2: most of it lies in a concept that has much else;
- else splits into all b with |a & b| > |b| / 2, where these together have more than half of a;
- else disappears.

The fate of a new concept is that of an old one with the versions exchanged, told the other way round: it persists, was
split off, was merged, or appears. Fates in terms of overlaps are those of Spiliopoulou et al., "MONIC: Modeling and
Monitoring Cluster Transitions", KDD 2006; the thresholds there are parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from service.engine.concepts import Concepts, concepts_at
from service.engine.errors import InvalidParameter
from service.engine.model import ShapeModel
from service.engine.recall import NOWHERE, place, recall, sees_as

Fate = Literal["persists", "merges", "splits", "disappears", "untold"]
PERSISTS = 0.5  # J above which two concepts are one
MOST_ASKED = 2000  # objects of one version alone of which the other one is asked; each costs about an answer


class CommonObjects(NamedTuple):
    """The objects by which two versions are compared (U).

    Attributes:
        old: (U,) int64: the old version's prototype that is the object, or is nearest to it; -1 for none.
        new: (U,) int64: that of the new version.
        shared: how many of them both versions learnt from.
        left_out: how many other clouds, which one version alone learnt from, play no part.
    """

    old: NDArray[np.int64]
    new: NDArray[np.int64]
    shared: int
    left_out: int


class Overlap(NamedTuple):
    """What a concept has in common with one of the other version.

    Attributes:
        concept: its place among the other version's.
        objects: how many objects they share.
        jaccard: that, over the objects of either, (0, 1].
    """

    concept: int
    objects: int
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
    objects: int
    overlaps: tuple[Overlap, ...]


class Comparison(NamedTuple):
    """Two versions, compared.

    Attributes:
        common: the objects by which they were.
        old_concepts: at the old version's epsilon_max.
        new_concepts: at the new version's epsilon_max.
        old: what becomes of each old concept.
        new: what each new concept becomes when the versions are exchanged: "merges" says that it was split off an old
            one, "splits" that it was merged of several, "disappears" that it appears.
    """

    common: CommonObjects
    old_concepts: Concepts
    new_concepts: Concepts
    old: tuple[Change, ...]
    new: tuple[Change, ...]


def compare(old: ShapeModel, new: ShapeModel, most_asked: int = MOST_ASKED) -> Comparison:
    """Compares the concepts of two versions at the filtration time epsilon_max of each.

    Args:
        old: the earlier version.
        new: the later version, of the same or of another name.
        most_asked: of more objects that only one of them learnt from, those of the lowest hashes are compared, and as
            large a share of the others: a sample that depends on nothing but the clouds.

    Raises:
        InvalidParameter: they have no cloud in common, and neither can be asked about what the other one recalls.
    """
    common = common_objects(old, new, most_asked)
    concepts = concepts_at(old.filtration), concepts_at(new.filtration)
    members = (
        members_of(concepts[0].assignment, len(concepts[0].ids), common.old),
        members_of(concepts[1].assignment, len(concepts[1].ids), common.new),
    )
    return Comparison(common, *concepts, changes(share(*members)), changes(share(*reversed(members))))


def common_objects(old: ShapeModel, new: ShapeModel, most_asked: int = MOST_ASKED) -> CommonObjects:
    """The objects of which both versions can tell the concepts, by ascending hash; arguments and errors: `compare`."""
    places = _places(old), _places(new)
    alone = sorted(places[0].keys() ^ places[1].keys())
    askable = [hash for hash in alone if (sees_as(new, old) if hash in places[0] else sees_as(old, new))]
    end = askable[most_asked] if len(askable) > most_asked else "g"  # hashes are hexadecimal
    both = [hash for hash in places[0].keys() & places[1].keys() if hash < end]
    chosen = sorted([*both, *(hash for hash in askable if hash < end)])
    if not chosen:
        raise InvalidParameter(
            "The two models learnt from no cloud in common, and describe objects in different ways, so that neither "
            "can be asked about what the other one recalls. Train one of them with the parameters of the other, or on "
            "some of its clouds."
        )
    return CommonObjects(
        _stand(old, places[0], new, places[1], chosen),
        _stand(new, places[1], old, places[0], chosen),
        shared=len(both),
        left_out=len(places[0].keys() | places[1].keys()) - len(chosen),
    )


class Shares(NamedTuple):
    """Which concepts of two versions have objects in common, and how many (P pairs).

    Attributes:
        pairs: (P, 2) int64: places of the old and of the new concept, in lexicographic order.
        shared: (P,) int64: objects in common, at least 1.
        sizes: (P, 2) int64: objects of either.
        old: (A,) int64: objects of each old concept.
        new: (B,) int64: objects of each new concept.
    """

    pairs: NDArray[np.int64]
    shared: NDArray[np.int64]
    sizes: NDArray[np.int64]
    old: NDArray[np.int64]
    new: NDArray[np.int64]

    @property
    def jaccard(self) -> NDArray[np.float64]:
        """(P,): the objects in common over those of either, (0, 1]."""
        return np.asarray(self.shared / (self.sizes.sum(axis=1) - self.shared))


def members_of(assignment: NDArray[np.int64], concepts: int, prototypes: NDArray[np.int64]) -> csr_array:
    """Which objects belong to which concept, (C, U) sparse int64.

    Args:
        assignment: (N,) the place of each prototype's concept, -1 for none.
        concepts: C.
        prototypes: (U,) that stand for the objects, -1 for none.
    """
    concept = np.where(prototypes == NOWHERE, NOWHERE, assignment[prototypes])
    held = np.flatnonzero(concept >= 0)
    return csr_array((np.ones(len(held), np.int64), (concept[held], held)), shape=(concepts, len(prototypes)))


def share(old: csr_array, new: csr_array) -> Shares:
    """What concepts (A, U) and (B, U) have in common."""
    of_old, of_new = (np.asarray(members.sum(axis=1), np.int64) for members in (old, new))
    common = csr_array(old @ new.T).tocoo()
    row, column = (axis.astype(np.int64) for axis in common.coords)
    order = np.lexsort((column, row))
    pairs = np.stack([row[order], column[order]], axis=1)
    sizes = np.stack([of_old[pairs[:, 0]], of_new[pairs[:, 1]]], axis=1)
    return Shares(pairs, common.data[order].astype(np.int64), sizes, of_old, of_new)


def changes(shares: Shares) -> tuple[Change, ...]:
    """What becomes of each old concept, by the rule above; concepts of one version have no object in common."""
    jaccard = shares.jaccard
    mostly_in, mostly_of = (2 * shares.shared[:, None] > shares.sizes).T
    start = np.searchsorted(shares.pairs[:, 0], np.arange(len(shares.old) + 1))
    return tuple(
        _change(shares, jaccard, mostly_in, mostly_of, range(start[a], start[a + 1]), int(size))
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
        a: Overlap(int(shares.pairs[row, 1]), int(shares.shared[row]), float(jaccard[row]))
        for a, row in best_of_old.items()
        if best_of_new[int(shares.pairs[row, 1])] == row and jaccard[row] > PERSISTS
    }


def _change(
    shares: Shares,
    jaccard: NDArray[np.float64],
    mostly_in: NDArray[np.bool_],
    mostly_of: NDArray[np.bool_],
    rows: range,
    size: int,
) -> Change:
    """What becomes of the concept whose pairs stand in some rows."""
    own = np.arange(rows.start, rows.stop)
    linked = own[mostly_in[own] | mostly_of[own]]
    overlaps = sorted(
        (Overlap(int(shares.pairs[row, 1]), int(shares.shared[row]), float(jaccard[row])) for row in linked),
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


def _places(model: ShapeModel) -> dict[str, int]:
    """The first training object of each hash."""
    places: dict[str, int] = {}
    for number, hash in enumerate(model.prototypes.cloud_hashes):
        places.setdefault(hash, number)
    return places


def _stand(
    model: ShapeModel, own: Mapping[str, int], other: ShapeModel, others: Mapping[str, int], hashes: Sequence[str]
) -> NDArray[np.int64]:
    """The prototype of a model that is each object, or is nearest to what the other model recalls of it."""
    foreign = [hash for hash in hashes if hash not in own]
    asked = dict(zip(foreign, place(model, recall(other, [others[hash] for hash in foreign])), strict=True))
    return np.array([own.get(hash, asked.get(hash, NOWHERE)) for hash in hashes], np.int64)
