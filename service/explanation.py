"""How an answer explains itself, in the one form that the command line and every transport share."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

from service.engine import explain as engine

_TOLD = ConfigDict(frozen=True, from_attributes=True)
_BY_JSD = "distances are Jensen-Shannon divergences, nats"


class Likeness(BaseModel):
    """A training object, and how far the cloud, or a part of it, is from it."""

    model_config = _TOLD

    object: int = Field(ge=0, description="its number among the model's training objects")
    key: str = Field(description="what its cloud was called in training")
    hash: str = Field(description="SHA-256 of its cloud's points, hexadecimal")
    distance: float = Field(description="0 for the same; where it is told it is said in which measure")


class SeenSegment(BaseModel):
    """One segment that the cloud was divided into; segments are numbered from 0, the largest first."""

    model_config = _TOLD

    share: float = Field(gt=0, le=1, description="of the surface seen")
    adjacent: list[int] = Field(description="numbers of the segments beside it")
    words: list[int] = Field(description="its visual word on each level of the dictionary, level 1 first")
    centroid_m: list[float] = Field(
        min_length=3, max_length=3, description="x right, y down, z forward from the sensor, metres"
    )
    extent_m: float = Field(description="diameter about the centroid that holds 98 % of it, metres")
    nearest: list[Likeness] = Field(
        description=f"training objects of which a part, or the whole, is most like it; {_BY_JSD}"
    )


class FiredVertex(BaseModel):
    """A motif vertex, and what fired it."""

    model_config = _TOLD

    vertex: int = Field(ge=0, description="its index in the stimuli vector")
    hierarchy: int = Field(ge=1, description="f of its hierarchy H_f, which speaks in the words of level f")
    also_in: list[int] = Field(
        description="further hierarchies where a vertex of the very same motif prototypes fired; it is not listed again"
    )
    level: int = Field(ge=1, description="motif level")
    words: list[int] = Field(description="its motif: visual words of level f, ascending")
    stimulus: float = Field(description="Eq. 1, scaled by rank where the model is balanced")
    segments: list[int] = Field(description="numbers of the cloud's segments whose constellation excites it most")
    prototypes: int = Field(ge=1, description="how many motif prototypes it memorises")
    nearest: list[Likeness] = Field(
        description=f"training objects of its motif prototypes most like that constellation; {_BY_JSD}"
    )


class NearConcept(BaseModel):
    """One of the best concepts."""

    model_config = _TOLD

    id: int = Field(description="as in `concepts`")
    nearest: list[Likeness] = Field(
        description="its prototypes nearest to the cloud; distances are the Mahalanobis distances that Eq. 4 averages"
    )


class Explanation(BaseModel):
    """Why an answer is what it is, so that a person can check it."""

    model_config = _TOLD

    segments: list[SeenSegment] = Field(description="what the cloud was divided into")
    vertices: list[FiredVertex] = Field(
        description="motif vertices that fired most, compared with the mean of their motif level"
    )
    concepts: list[NearConcept] = Field(description="the best concepts, as ranked")
    wholes: list[Likeness] = Field(
        description=f"training objects most like the cloud as a whole, the first of which novelty is by; {_BY_JSD}"
    )
    thumbnails: str = Field(description="path under which the service shows a training object, by its number, as PNG")


def tell(explanation: engine.Explanation, model: tuple[str, int]) -> Explanation:
    """The explanation of a response of a model, given by name and version."""
    name, version = model
    told = {part: getattr(explanation, part) for part in engine.Explanation._fields}
    return Explanation(**told, thumbnails=f"/v1/models/{name}/versions/{version}/objects/{{object}}.png")
