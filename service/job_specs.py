"""What jobs are to do: a kind of work, and what it needs to know."""

from __future__ import annotations

import re
from typing import Annotated, Any, Final, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, JsonValue, TypeAdapter, ValidationError, model_validator

from service.engine.errors import InvalidParameter
from service.engine.params import ModelParams
from service.model_file import NAME

TRAIN: Final = "train"
EVALUATE: Final = "evaluate"
SIMULATE: Final = "simulate"
KINDS = (TRAIN, EVALUATE, SIMULATE)
LONGEST = 63  # characters of a job's id
REFERENCE = f"^{NAME}(@{NAME}|:[0-9]{{1,8}})?$"

Name = Annotated[str, Field(pattern=f"^{NAME}$", max_length=63)]
Seed = Annotated[int, Field(ge=0, le=2**63 - 1)]
Simulation = Annotated[
    dict[str, JsonValue], Field(description="parameters of the simulation that differ from the default")
]


class _Work(BaseModel):
    """What all jobs have."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    timeout: float | None = Field(
        None, gt=0, le=1e8, description="after this time from when it was first begun, the job fails, seconds"
    )
    attempts: int = Field(
        5,
        ge=1,
        le=20,
        description="how often a stage is tried that fails for want of something, such as the store",
    )


class TrainSpec(_Work):
    """Learns concepts from clouds, and publishes them as the next version of a model."""

    kind: Literal["train"] = Field(TRAIN, description="the work")
    name: Name = Field(description="name of the model")
    alias: Name | None = Field("production", description="alias that shall mean the new version, if any")
    datasets: tuple[Name, ...] = Field((), max_length=1000, description="learn from the clouds of these datasets")
    simulate: int | None = Field(None, ge=2, le=10_000_000, description="learn from so many simulated objects")
    clouds: str | None = Field(None, description="learn from all clouds of this folder, as the worker sees it")
    labelled: Name | None = Field(
        None, description="dataset with labels, by which the model is judged before it is published"
    )
    promote: Literal["always", "not-worse", "never"] = Field(
        "always",
        description="whether the alias moves to the new version: always; if its figures by the labels are not worse "
        "than those of the version that the alias means; or never, so that somebody does it by hand",
    )
    tolerance: float = Field(
        0.02, ge=0, le=1, description="with not-worse: by how much each figure may be lower than before, in [0, 1]"
    )
    extend: str | None = Field(
        None,
        pattern=REFERENCE,
        max_length=127,
        description="learn from what this model learnt from, and then from what else is named; it is the parent",
    )
    parent: str | None = Field(
        None, pattern=REFERENCE, max_length=127, description="the model that the new version follows, for its manifest"
    )
    seed: Seed = Field(7, description="seed of all random draws")
    params: ModelParams = Field(default_factory=ModelParams, description="parameters of every stage")
    simulation: Simulation = Field(default_factory=dict)

    @model_validator(mode="after")
    def _has_source(self) -> Self:
        if not self.datasets and self.simulate is None and self.clouds is None and self.extend is None:
            raise ValueError("give at least one of datasets, simulate, clouds and extend to learn from")
        if self.extend is not None and self.parent is not None:
            raise ValueError("the model that is extended is the parent: give no other one")
        if self.promote == "not-worse" and (self.labelled is None or self.alias is None):
            raise ValueError("to be promoted if not worse, give a labelled dataset to judge by, and the alias to move")
        if len(set(self.datasets)) < len(self.datasets):
            raise ValueError("a dataset is named twice")
        return self


class EvaluateSpec(_Work):
    """Judges a model by the labels of a dataset, and keeps the report."""

    kind: Literal["evaluate"] = Field(EVALUATE, description="the work")
    model: str = Field(pattern=REFERENCE, max_length=127, description="NAME, NAME@ALIAS or NAME:VERSION")
    dataset: Name = Field(description="whose labels judge it")
    robustness: bool = Field(False, description="whether its clouds are answered under disturbances as well")


class SimulateSpec(_Work):
    """Simulates objects, and adds their clouds to a dataset."""

    kind: Literal["simulate"] = Field(SIMULATE, description="the work")
    dataset: Name = Field(description="that the clouds are added to; made if there is none")
    count: int = Field(ge=1, le=10_000_000, description="number of objects")
    seed: Seed = Field(7, description="seed of all random draws")
    simulation: Simulation = Field(default_factory=dict)


JobSpec = TrainSpec | EvaluateSpec | SimulateSpec
_SPECS: TypeAdapter[JobSpec] = TypeAdapter(Annotated[JobSpec, Field(discriminator="kind")])


def read_spec(given: dict[str, Any]) -> JobSpec:
    """The job that these values describe; one without a kind trains.

    Raises:
        InvalidParameter: they describe none.
    """
    try:
        return _SPECS.validate_python({"kind": TRAIN} | given)
    except ValidationError as error:
        faults = error.errors(include_url=False, include_input=False)[:5]
        said = "; ".join(f"{_place(fault['loc'])}{_what(fault['msg'])}"[:300] for fault in faults)
        raise InvalidParameter(f"There cannot be such a job: {said}.") from error


def check_id(job_id: str) -> None:
    """Refuses what cannot be the id of a job.

    Raises:
        InvalidParameter: it is not of the form of `NAME`.
    """
    if not re.fullmatch(NAME, job_id) or len(job_id) > LONGEST:
        raise InvalidParameter(
            f"'{job_id[:100]}' cannot be the id of a job: lower-case letters, digits and hyphens, at most {LONGEST}; "
            "a UUID is one."
        )


def _place(loc: tuple[int | str, ...]) -> str:
    """Where a fault is; the kind goes before it in what pydantic says, but not in what was given."""
    place = ".".join(str(part) for part in (loc[1:] if loc and loc[0] in KINDS else loc))
    return f"{place}: " if place else ""


def _what(message: str) -> str:
    """What pydantic says of a fault, in our words where it has its own."""
    message = message.removeprefix("Value error, ").replace("Extra inputs are not permitted", "there is no such field")
    if message == f"String should match pattern '^{NAME}$'":
        return "lower-case letters, digits and hyphens, a letter or digit first"
    return message
