"""What became of a model's concepts in another version, as the command line and every transport tell it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Literal, NamedTuple

from pydantic import BaseModel, ConfigDict, Field

from service.engine.compare import Comparison, affordable, compare
from service.engine.concepts import Concepts
from service.engine.fates import Change, Fate
from service.engine.model import ShapeModel

WORK = 4_000_000  # of one comparison, in pairs of an object and a motif prototype: seconds, however large the models
_FROZEN = ConfigDict(frozen=True)
Origin = Literal["persists", "split-off", "merged", "appears", "untold"]
ORIGINS: dict[Fate, Origin] = {  # what a fate is, seen from the other end
    "persists": "persists",
    "merges": "split-off",
    "splits": "merged",
    "disappears": "appears",
    "untold": "untold",
}
_OBJECTS = "of the objects compared, those that it has; estimated where a sample stands for all"


class Version(NamedTuple):
    """A version to be compared: what it is called, what it learnt, and what its concepts are called."""

    name: str
    version: int
    model: ShapeModel
    names: Mapping[int, str]


class ComparedVersion(BaseModel):
    """One of the two versions."""

    model_config = _FROZEN

    model: str = Field(description="name of the model")
    version: int = Field(ge=1, description="its version")
    time: float = Field(ge=0, le=1, description="filtration time of its concepts: epsilon_max")


class RelatedConcept(BaseModel):
    """A concept of the other version that holds most of a concept, or is mostly part of it."""

    model_config = _FROZEN

    id: int = Field(description="its node in the other version's merge tree")
    name: str | None = Field(description="its name, null if none")
    objects: int = Field(description="objects that both have; estimated where a sample stands for all")
    jaccard: float = Field(gt=0, le=1, description="these over the objects that either has; above 0.5 they are one")


class _ComparedConcept(BaseModel):
    model_config = _FROZEN

    id: int = Field(description="its node in its version's merge tree")
    name: str | None = Field(description="its name, null if none")
    prototypes: int = Field(ge=2, description="training objects that make it up")
    objects: int = Field(ge=0, description=_OBJECTS)
    concepts: list[RelatedConcept] = Field(description="of the other version, most objects first")


class OldConcept(_ComparedConcept):
    """A concept of the old version, and what becomes of it."""

    fate: Fate = Field(
        description="persists: more than half of the objects of it and of a new concept are common to both; merges: "
        "most of it lies in a larger one; splits: most of it lies in new ones that are mostly part of it; disappears: "
        "none of these; untold: it has none of the objects compared"
    )


class NewConcept(_ComparedConcept):
    """A concept of the new version, and where it comes from."""

    origin: Origin = Field(
        description="persists; split-off: most of it lies in a larger old one; merged: most of it comes from old ones "
        "that went mostly into it; appears: none of these; untold: it has none of the objects compared"
    )


class SameConcept(BaseModel):
    """An old and a new concept that are one, at whatever filtration times."""

    model_config = _FROZEN

    old: int = Field(description="its id in the old version")
    new: int = Field(description="its id in the new version")
    jaccard: float = Field(gt=0, le=1, description="objects that both have over those that either has, above 0.5")
    old_name: str | None = Field(description="what the old version calls it")
    new_name: str | None = Field(description="what the new version calls it")


class VersionComparison(BaseModel):
    """Two versions, compared by the clouds that they learnt from."""

    model_config = _FROZEN

    old: ComparedVersion = Field(description="the version that concepts come from")
    new: ComparedVersion = Field(description="the version that they go to")
    shared: int = Field(ge=0, description="clouds that both learnt from: the same by their hashes")
    asked: int = Field(
        ge=0,
        description="clouds that one of them learnt from, and that the other was asked for by what the first recalls",
    )
    left_out: int = Field(
        ge=0,
        description="clouds that one of them learnt from and the other cannot be asked for, as it describes otherwise",
    )
    fates: dict[Fate, int] = Field(description="how many old concepts have each fate")
    origins: dict[Origin, int] = Field(description="how many new concepts have each origin")
    old_concepts: list[OldConcept] = Field(description="those at epsilon_max, largest first")
    new_concepts: list[NewConcept] = Field(description="those at epsilon_max, largest first")
    same_concepts: list[SameConcept] = Field(
        description="concepts of all filtration times that clouds are answered with: each old one is the most alike of "
        "the new one and the other way round"
    )


def compare_versions(old: Version, new: Version) -> VersionComparison:
    """Compares two versions of a model, or two models.

    Raises:
        InvalidParameter: there is nothing to compare them by.
    """
    compared = compare(old.model, new.model, affordable(old.model, new.model, WORK))
    fates = Counter(change.fate for change in compared.old)
    origins = Counter(ORIGINS[change.fate] for change in compared.new)
    return VersionComparison(
        old=ComparedVersion(model=old.name, version=old.version, time=compared.old_concepts.time),
        new=ComparedVersion(model=new.name, version=new.version, time=compared.new_concepts.time),
        shared=compared.common.shared,
        asked=len(compared.common.old) - compared.common.shared,
        left_out=compared.common.left_out,
        fates={fate: fates[fate] for fate in ORIGINS if fates[fate]},
        origins={origin: origins[origin] for origin in ORIGINS.values() if origins[origin]},
        old_concepts=[
            OldConcept(fate=change.fate, **_told(change, place, compared.old_concepts, old, compared.new_concepts, new))
            for place, change in enumerate(compared.old)
        ],
        new_concepts=[
            NewConcept(
                origin=ORIGINS[change.fate],
                **_told(change, place, compared.new_concepts, new, compared.old_concepts, old),
            )
            for place, change in enumerate(compared.new)
        ],
        same_concepts=_same(compared, old, new),
    )


def _told(
    change: Change, place: int, concepts: Concepts, version: Version, others: Concepts, other: Version
) -> dict[str, object]:
    """What is told of one concept."""
    node = int(concepts.ids[place])
    related = [
        RelatedConcept(
            id=int(others.ids[overlap.concept]),
            name=other.names.get(int(others.ids[overlap.concept])),
            objects=round(overlap.objects),
            jaccard=overlap.jaccard,
        )
        for overlap in change.overlaps
    ]
    return {
        "id": node,
        "name": version.names.get(node),
        "prototypes": int(concepts.sizes[place]),
        "objects": round(change.objects),
        "concepts": related,
    }


def _same(compared: Comparison, old: Version, new: Version) -> list[SameConcept]:
    return [
        SameConcept(
            old=found.old,
            new=found.new,
            jaccard=found.jaccard,
            old_name=old.names.get(found.old),
            new_name=new.names.get(found.new),
        )
        for found in compared.counterparts
    ]
