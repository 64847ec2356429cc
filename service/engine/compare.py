"""Two versions of a model: which concepts persist, merge, split, appear and disappear.

Concepts are sets of prototypes, so two versions are compared by the objects that both can tell the concepts of. These
are all clouds that either has learnt from, each by the hash of its points. An object that a model learnt from is its
own prototype; of any other one the model is asked, by what the other model recalls of it, which of its prototypes is
the nearest (`recall.place`), or none where the object is novel to it. So every concept, of either version and of any
filtration time, is a set of the same objects, and `fates` says what becomes of sets.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, vstack

from service.engine.concepts import Concepts, concepts_at, is_concept
from service.engine.errors import InvalidParameter
from service.engine.fates import Change, changes, counterparts, share
from service.engine.model import ShapeModel
from service.engine.recall import NOWHERE, place, recall, sees_as

MOST_ASKED = 500  # objects of one version alone of which the other one is asked; each costs about an answer
LEAST_ASKED = 20


class CommonObjects(NamedTuple):
    """The objects by which two versions are compared (U).

    Attributes:
        old: (U,) int64: the old version's prototype that is the object, or is nearest to it; -1 for none.
        new: (U,) int64: that of the new version.
        weight: (U,) float64: how many objects each stands for: 1, or more where it is one of a sample.
        shared: how many of them both versions learnt from.
        left_out: how many clouds, which one version alone learnt from, no object stands for.
    """

    old: NDArray[np.int64]
    new: NDArray[np.int64]
    weight: NDArray[np.float64]
    shared: int
    left_out: int


class Counterpart(NamedTuple):
    """The new concept that an old one is.

    Attributes:
        old: node in the old version's merge tree.
        new: node in the new version's merge tree.
        jaccard: objects in common over those of either, above 1/2.
    """

    old: int
    new: int
    jaccard: float


class Comparison(NamedTuple):
    """Two versions, compared.

    Attributes:
        common: the objects by which they were.
        old_concepts: at the old version's epsilon_max.
        new_concepts: at the new version's epsilon_max.
        old: what becomes of each old concept.
        new: what each new concept becomes when the versions are exchanged: "merges" says that it was split off an old
            one, "splits" that it was merged of several, "disappears" that it appears.
        counterparts: old and new concepts that are the same, of all filtration times at which clouds are answered.
    """

    common: CommonObjects
    old_concepts: Concepts
    new_concepts: Concepts
    old: tuple[Change, ...]
    new: tuple[Change, ...]
    counterparts: tuple[Counterpart, ...]


def compare(old: ShapeModel, new: ShapeModel, most_asked: int = MOST_ASKED) -> Comparison:
    """Compares the concepts of two versions at the filtration time epsilon_max of each.

    Args:
        old: the earlier version.
        new: the later version, of the same or of another name.
        most_asked: of more objects that only one of them learnt from, those of the lowest hashes stand for all: a
            sample that depends on nothing but the clouds.

    Raises:
        InvalidParameter: they have no cloud in common, and neither can be asked about what the other one recalls.
    """
    common = common_objects(old, new, most_asked)
    concepts = concepts_at(old.filtration), concepts_at(new.filtration)
    of_old, of_new = _objects_of(concepts[0], common.old), _objects_of(concepts[1], common.new)
    return Comparison(
        common,
        *concepts,
        changes(share(of_old, of_new, common.weight)),
        changes(share(of_new, of_old, common.weight)),
        find_counterparts(old, new, common),
    )


def find_counterparts(
    old: ShapeModel, new: ShapeModel, common: CommonObjects, besides: Iterable[int] = ()
) -> tuple[Counterpart, ...]:
    """Old and new concepts that are the same, whatever their filtration times: J > 1/2, and each other's most alike.

    Args:
        old: the earlier version.
        new: the later version.
        common: their common objects.
        besides: old concepts of which it shall be told as well, though clouds are not answered with them.
    """
    spectra = old.spectrum(), new.spectrum()
    more = [node for node in sorted(set(besides) - set(spectra[0].ids.tolist())) if is_concept(old.filtration, node)]
    ids = [*spectra[0].ids.tolist(), *more]
    memberships = [csr_array(spectra[0].membership), *(_members(old, node) for node in more)]
    found = counterparts(
        share(
            _stand_for(csr_array(vstack(memberships, format="csr")), common.old),
            _stand_for(csr_array(spectra[1].membership), common.new),
            common.weight,
        )
    )
    return tuple(Counterpart(ids[a], int(spectra[1].ids[o.concept]), o.jaccard) for a, o in sorted(found.items()))


def affordable(old: ShapeModel, new: ShapeModel, work: int) -> int:
    """Objects of one version of which the other is asked, at most `MOST_ASKED`, so that it takes but so much work.

    Args:
        old: the earlier version.
        new: the later version.
        work: pairs of an object that is asked for and a motif prototype; 10,000 or so take what an answer takes.
    """
    largest = max(len(model.ensemble.prototypes) for model in (old, new))
    return min(MOST_ASKED, max(work // largest, LEAST_ASKED))


def common_objects(old: ShapeModel, new: ShapeModel, most_asked: int = MOST_ASKED) -> CommonObjects:
    """The objects of which both versions can tell the concepts, by ascending hash; arguments and errors: `compare`."""
    places = _places(old), _places(new)
    weights = dict.fromkeys(places[0].keys() & places[1].keys(), 1.0)
    shared = len(weights)
    for asked, recalling, own, others in ((new, old, places[1], places[0]), (old, new, places[0], places[1])):
        alone = sorted(others.keys() - own.keys()) if sees_as(asked, recalling) else []
        weights |= dict.fromkeys(alone[:most_asked], max(1.0, len(alone) / most_asked))
    chosen = sorted(weights)
    if not chosen:
        raise InvalidParameter(
            "The two models learnt from no cloud in common, and describe objects in different ways, so that neither "
            "can be asked about what the other one recalls. Train one of them with the parameters of the other, or on "
            "some of its clouds."
        )
    return CommonObjects(
        _stand(old, places[0], new, places[1], chosen),
        _stand(new, places[1], old, places[0], chosen),
        np.array([weights[hash] for hash in chosen]),
        shared=shared,
        left_out=len(places[0].keys() | places[1].keys()) - round(sum(weights.values())),
    )


def _objects_of(concepts: Concepts, prototypes: NDArray[np.int64]) -> csr_array:
    """Which objects, for which prototypes (U,) stand, belong to which concept of one time, (C, U) sparse."""
    kept = np.flatnonzero(concepts.assignment >= 0)
    shape = (len(concepts.ids), len(concepts.assignment))
    members = csr_array((np.ones(len(kept)), (concepts.assignment[kept], kept)), shape=shape)
    return _stand_for(members, prototypes)


def _members(model: ShapeModel, node: int) -> csr_array:
    """The prototypes of one concept of any time (1, N) sparse."""
    size = len(model.filtration.time) + 1
    concepts = concepts_at(model.filtration, float(model.filtration.time[model.filtration.order == node - size][0]))
    return csr_array(concepts.assignment[None] == int(np.flatnonzero(concepts.ids == node)[0])).astype(np.float64)


def _stand_for(members: csr_array, prototypes: NDArray[np.int64]) -> csr_array:
    """Which objects belong to concepts (C, U), by the concepts' prototypes (C, N) and the one of each object (U,)."""
    known = np.flatnonzero(prototypes != NOWHERE)
    objects = csr_array(
        (np.ones(len(known), np.int64), (prototypes[known], known)), shape=(members.shape[1], len(prototypes))
    )
    held = csr_array((np.ones(members.nnz, np.int64), members.indices, members.indptr), shape=members.shape)
    return csr_array(held @ objects)


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
