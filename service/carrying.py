"""Names carry over: what an earlier version's concepts are called, the later one's are where they still are the same.

A name attaches to the concept that is the same by `engine.compare`, whatever its filtration time: J > 1/2, and each the
other's most alike. That goes for the larger part of a split and for the larger partner of a merge too, if it is so much
larger; a part that is not keeps no name, since nobody has looked whether it fits. What a person has named, or whose
name a person has taken away, stays as it is.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping

from pydantic import BaseModel, ConfigDict, Field

from service.engine.compare import MOST_ASKED, common_objects, find_counterparts
from service.engine.errors import InvalidParameter, ModelDamaged, ModelIncompatible, ModelNotFound
from service.engine.model import ShapeModel
from service.store import ModelStore

log = logging.getLogger(__name__)


class CarriedName(BaseModel):
    """A name that an earlier version's concept had and a later one's has now."""

    model_config = ConfigDict(frozen=True)

    concept: int = Field(description="id of the concept that is called so now")
    name: str = Field(description="what it is called")
    before: int = Field(description="id of the earlier version's concept of that name")
    jaccard: float = Field(gt=0, le=1, description="objects that both have over those that either has, above 0.5")


def names_to_carry(
    old: ShapeModel, names: Mapping[int, str], new: ShapeModel, most_asked: int = MOST_ASKED
) -> list[CarriedName]:
    """The names of an earlier version that still fit, by the later version's concepts.

    Args:
        old: the earlier version.
        names: of its concepts.
        new: the later version.
        most_asked: as of `compare`.

    Raises:
        InvalidParameter: there is nothing to compare them by.
    """
    found = find_counterparts(old, new, common_objects(old, new, most_asked), besides=names)
    return [
        CarriedName(concept=each.new, name=names[each.old], before=each.old, jaccard=each.jaccard)
        for each in found
        if each.old in names
    ]


def carry_names(store: ModelStore, source: tuple[str, int], target: tuple[str, int]) -> list[CarriedName]:
    """Carries the names of one version over to another one; done twice, it is done once.

    Args:
        store: that holds both.
        source: name and version of the model that has names.
        target: name and version of the one that gets them.

    Returns:
        The names that the target has from the source now.

    Raises:
        InvalidParameter: there is nothing to compare them by.
        ModelNotFound, ModelDamaged, ModelIncompatible: one of them cannot be had.
    """
    names = store.concept_names(*source).read().of
    if not names:
        return []
    fitting = names_to_carry(store.load(*source)[0], names, store.load(*target)[0])
    return keep_carried(store, source, target, fitting)


def keep_carried(
    store: ModelStore, source: tuple[str, int], target: tuple[str, int], fitting: list[CarriedName]
) -> list[CarriedName]:
    """Writes down the names that fit, and returns those that nothing stood against."""
    called = "{}:{}".format(*source)
    log = store.concept_names(*target)
    kept = log.carry({each.concept: each.name for each in fitting}, called)
    return [
        each for each in fitting if kept.of.get(each.concept) == each.name and kept.carried.get(each.concept) == called
    ]


def carry_from_earlier(store: ModelStore, earlier: str | None, target: tuple[str, int]) -> list[CarriedName]:
    """Carries names over to a version that was just published, if the one before it can be compared with it.

    Args:
        store: that holds both.
        earlier: NAME:VERSION of the version before; None for none.
        target: name and version of the new one, which is there whether names fit or not.
    """
    if earlier is None:
        return []
    try:
        source = store.resolve(earlier)
        return [] if source == target else carry_names(store, source, target)
    except (InvalidParameter, ModelNotFound, ModelDamaged, ModelIncompatible) as error:
        log.warning("no names are carried over from %s to %s:%d: %s", earlier, *target, error)
        return []
