"""What is said about a cloud, in the one form that the command line and every transport share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from service.engine.model import Response
from service.explanation import Explanation, tell


class Concept(BaseModel):
    """One concept, as it stands to the cloud."""

    model_config = ConfigDict(frozen=True)

    id: int = Field(description="node of the concept in the model's merge tree: the same at every filtration time")
    name: str | None = Field(None, description="name that people gave to the concept, null if none")
    response: float = Field(description="the form that is scored, smaller is closer")
    distance: float = Field(description="mean Mahalanobis distance to the concept's prototypes, Eq. 4")
    rank: int = Field(ge=1, description="1 is the closest concept of the answer's time; those of other times follow")
    prototypes: int = Field(description="training objects that make up the concept")
    time: float = Field(ge=0, le=1, description="filtration time at which it was taken: 0 specific, 1 generic")


class Stimuli(BaseModel):
    """The cloud's stimuli vector without its zeros."""

    model_config = ConfigDict(frozen=True)

    index: list[int] = Field(description="motif vertices that fired, ascending")
    value: list[float] = Field(description="their stimuli, float32, Eq. 1, scaled by rank where the model is balanced")


def _without_all_responses(schema: dict[str, Any]) -> None:
    """A transport may leave out the responses to all concepts, where only the ranked ones were asked for."""
    schema["required"] = [field for field in schema["required"] if field not in ("responses", "distances")]


class Answer(BaseModel):
    """Which concepts of a model a cloud resembles, and how much. Floats are exact: read back, they are the same."""

    model_config = ConfigDict(frozen=True, json_schema_extra=_without_all_responses)

    model: str = Field(description="name of the model that answered")
    version: int = Field(ge=1, description="its version")
    time: float = Field(ge=0, le=1, description="filtration time of the first concepts: 0 specific, 1 generic")
    responses: list[float] = Field(description="of every concept, in concept order: the scored form, smaller is closer")
    distances: list[float] = Field(description="of every concept, in concept order: Eq. 4, as the paper has it")
    concepts: list[Concept] = Field(
        description="those of the answer's time, then those of other times, best first; as many as `top` asked for"
    )
    novelty: float = Field(
        ge=0,
        le=1,
        description="how unlike everything learned the object is: the share of the training objects that are less "
        "far from all others than the object is from all of them. Objects like the learned ones have any value "
        "equally often; at 0.95 it is farther from everything learned than 95 % of that is from one another",
    )
    segments: int = Field(ge=0, description="segments that the cloud was divided into")
    extent_m: float = Field(description="the object's robust diameter, metres")
    truncated: bool = Field(description="whether constellations were left out because there were too many")
    warnings: list[str] = Field(description="what is odd about the cloud, in sentences")
    timings_ms: dict[str, float] = Field(description="how long each stage took, milliseconds")
    stimuli: Stimuli | None = Field(
        None, description="the stimuli vector, if it was asked for", exclude_if=lambda value: value is None
    )
    explanation: Explanation | None = Field(
        None, description="why the answer is what it is, if that was asked for", exclude_if=lambda value: value is None
    )
    point_segments: list[int] | None = Field(
        None,
        description="number of the segment of each point of the cloud as it was sent, in its order, if that was asked "
        "for; -1 for points that were not measured or are part of no segment",
        exclude_if=lambda value: value is None,
    )


def compose(
    response: Response,
    model: tuple[str, int],
    timings_ms: dict[str, float],
    *,
    top: int | None,
    stimuli: bool,
    names: Mapping[int, str] | None = None,
) -> Answer:
    """The answer that a response makes.

    Args:
        response: of the engine.
        model: name and version that gave it.
        timings_ms: of each stage, milliseconds.
        top: how many of the best concepts are listed, None for all; `responses` and `distances` are whole always.
        stimuli: whether the stimuli vector is part of the answer.
        names: that people gave to concepts.
    """
    points, explanation = response.point_segments, response.explanation
    facts = {
        "model": model[0],
        "version": model[1],
        "time": response.time,
        "responses": response.responses.tolist(),
        "distances": response.distances.tolist(),
        "concepts": _listed(response, top, names or {}),
        "novelty": response.novelty,
        "segments": response.segments,
        "extent_m": response.extent_m,
        "truncated": response.truncated,
        "warnings": list(response.warnings),
        "timings_ms": timings_ms,
        "stimuli": _stimuli(response) if stimuli else None,
        "explanation": None if explanation is None else tell(explanation, model),
        "point_segments": None if points is None else points.tolist(),
    }
    return Answer.model_validate(facts)  # all concepts at one go: one by one they take twice as long


def _listed(response: Response, top: int | None, names: Mapping[int, str]) -> list[dict[str, Any]]:
    """The best concepts, as fields of `Concept`."""
    best = response.ranking[:top]
    rows = zip(
        response.concept_ids[best].tolist(),
        response.responses[best].tolist(),
        response.distances[best].tolist(),
        response.concept_sizes[best].tolist(),
        response.concept_times[best].tolist(),
        strict=True,
    )
    return [
        {
            "id": id,
            "name": names.get(id),
            "response": value,
            "distance": distance,
            "rank": rank,
            "prototypes": prototypes,
            "time": time,
        }
        for rank, (id, value, distance, prototypes, time) in enumerate(rows, 1)
    ]


def _stimuli(response: Response) -> Stimuli:
    index, value = response.stimuli
    return Stimuli(index=index.tolist(), value=value.tolist())
