"""What a model holds, as every transport tells it: its concepts, and the space and the filtration they come from."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from service.engine.filtration import annexations_over_time, barcode
from service.engine.model import ShapeModel

_FROZEN = ConfigDict(frozen=True)
_TIME = "filtration time in [0, 1]"

Pair = Annotated[list[int], Field(min_length=2, max_length=2)]
Bar = Annotated[list[float | None], Field(min_length=2, max_length=2)]


class Held(BaseModel):
    """Something that a version of a model holds."""

    model_config = _FROZEN

    model: str = Field(description="name of the model")
    version: int = Field(ge=1, description="its version")
    epsilon_max: float = Field(description=f"{_TIME} at which concepts are taken unless another one is asked for")


class LearnedObject(BaseModel):
    """A training object."""

    model_config = _FROZEN

    object: int = Field(ge=0, description="its number among the model's training objects")
    key: str = Field(description="what its cloud was called in training")
    hash: str = Field(description="SHA-256 of its cloud's points, hexadecimal")
    map: list[float] = Field(min_length=2, max_length=2, description="its place on the map CR^2, no unit")


class LearnedConcept(BaseModel):
    """One concept."""

    model_config = _FROZEN

    id: int = Field(description="node of the concept in the model's merge tree: the same at every filtration time")
    name: str | None = Field(description="name that people gave to it, null if none")
    prototypes: int = Field(ge=2, description="training objects that make it up")
    time: float = Field(ge=0, le=1, description="filtration time at which it was taken: 0 specific, 1 generic")
    objects: list[int] = Field(description="numbers of these training objects, ascending")


class ConceptList(Held):
    """The concepts of a version."""

    time: float = Field(ge=0, le=1, description="filtration time of the first concepts: 0 specific, 1 generic")
    concepts: list[LearnedConcept] = Field(
        description="in concept order, that of an answer's `responses`: those at `time`, largest first, and if no time "
        "was asked for those of other times"
    )
    objects: list[LearnedObject] = Field(description="all training objects (N), by number")
    thumbnails: str = Field(description="path under which the service shows a training object, by its number, as PNG")


class Barcode(Held):
    """The barcode of H_0."""

    bars: list[Bar] = Field(
        description=f"(N, 2): birth and death of each component, {_TIME}, by death; null for the one that never dies"
    )


class AnnexationGraph(Held):
    """The annexation graph F: which component took in which, and when. Rows are those of the tree's edges."""

    edges: list[Pair] = Field(
        description="(N-1, 2): numbers of the training objects that represent the component taken in, the smaller one, "
        "and the one that took it in"
    )
    time: list[float] = Field(description=f"(N-1): {_TIME} of each annexation")
    order: list[int] = Field(
        description="(N-1): its place among all, 0 the earliest; N + place is the node that it makes in the merge tree"
    )
    distance: list[float] = Field(
        description="(N-1): heat of the edge, from vertex heats scaled to [0, 1] and inverted; no unit"
    )
    moments: list[float] = Field(description=f"(M): each {_TIME} at which something is annexed, ascending")
    annexations: list[int] = Field(description="(M): how many annexations each of these moments saw")


class Tree(Held):
    """The spanning tree of the topological space. Edges are in lexicographic order."""

    edges: list[Pair] = Field(description="(N-1, 2): numbers of the training objects, smaller one first")
    distance: list[float] = Field(description="(N-1): Jensen-Shannon divergence of the two stimuli vectors, nats")
    vertex_heat: list[float] = Field(
        description="(N): mean geodesic distance of each training object to all, edges of length 1, Eq. 3"
    )


def list_concepts(
    model: ShapeModel, called: tuple[str, int], time: float | None, names: Mapping[int, str]
) -> ConceptList:
    """The concepts of a model.

    Args:
        model: the model.
        called: its name and version.
        time: filtration time in [0, 1]; None for all that clouds are compared with.
        names: that people gave to concepts.

    Raises:
        InvalidParameter: the time is out of range.
    """
    spectrum, objects = model.spectrum(time), model.prototypes
    name, version = called
    return ConceptList(
        **_held(model, called),
        time=spectrum.concepts.time,
        concepts=[
            LearnedConcept(
                id=node,
                name=names.get(node),
                prototypes=int(spectrum.sizes[place]),
                time=float(spectrum.times[place]),
                objects=spectrum.members(place).tolist(),
            )
            for place, node in enumerate(spectrum.ids.tolist())
        ],
        objects=[
            LearnedObject(object=number, key=key, hash=sha256, map=place)
            for number, (key, sha256, place) in enumerate(
                zip(objects.cloud_keys, objects.cloud_hashes, objects.map.tolist(), strict=True)
            )
        ],
        thumbnails=f"/v1/models/{name}/versions/{version}/objects/{{object}}.png",
    )


def tell_barcode(model: ShapeModel, called: tuple[str, int]) -> Barcode:
    """The barcode of a model, given with its name and version."""
    bars = [[birth, death if math.isfinite(death) else None] for birth, death in barcode(model.filtration).tolist()]
    return Barcode(**_held(model, called), bars=bars)


def tell_annexations(model: ShapeModel, called: tuple[str, int]) -> AnnexationGraph:
    """The annexation graph of a model, given with its name and version."""
    filtration = model.filtration
    times, counts = annexations_over_time(filtration)
    return AnnexationGraph(
        **_held(model, called),
        edges=np.stack([filtration.annexed, filtration.annexing], axis=1).tolist(),
        time=filtration.time.tolist(),
        order=filtration.order.tolist(),
        distance=filtration.distance.tolist(),
        moments=times.tolist(),
        annexations=counts.tolist(),
    )


def tell_tree(model: ShapeModel, called: tuple[str, int]) -> Tree:
    """The tree of a model, given with its name and version."""
    space = model.space
    return Tree(
        **_held(model, called),
        edges=space.edges.tolist(),
        distance=space.distance.tolist(),
        vertex_heat=space.vertex_heat.tolist(),
    )


def _held(model: ShapeModel, called: tuple[str, int]) -> dict[str, Any]:
    return {"model": called[0], "version": called[1], "epsilon_max": model.filtration.epsilon_max}
