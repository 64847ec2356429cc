"""A job as it stands: its state, how far it is, what it has made, or why it failed."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

from pydantic import BaseModel, Field, TypeAdapter

from service.engine import errors
from service.engine.errors import ShapeConceptsError
from service.job_records import Progress
from service.job_specs import JobSpec, read_spec

if TYPE_CHECKING:
    from dbos import WorkflowStatus

State = Literal["queued", "running", "done", "failed", "cancelled"]
STATES: tuple[State, ...] = get_args(State)
OVER: tuple[State, ...] = ("done", "failed", "cancelled")
ENGINE_STATES: dict[str, State] = {
    "ENQUEUED": "queued",
    "DELAYED": "queued",
    "PENDING": "running",
    "SUCCESS": "done",
    "ERROR": "failed",
    "MAX_RECOVERY_ATTEMPTS_EXCEEDED": "failed",
    "CANCELLED": "cancelled",
}


class Trained(BaseModel):
    """What a job that trains has made."""

    kind: Literal["train"] = Field("train", description="the kind of job")
    model: str = Field(description="name of the model")
    version: int = Field(ge=1, description="the version published")
    parent: str | None = Field(None, description="NAME:VERSION of the model that it follows")
    metrics: dict[str, float] | None = Field(None, description="figures by which it was judged; 1 is best")
    names_carried: int = Field(0, ge=0, description="names of concepts that it has from the version before")
    promoted: bool = Field(True, description="whether the alias was moved to it")
    reasons: list[str] = Field([], description="why it was promoted, or not, by the rule; a sentence for each figure")
    clouds: int = Field(description="clouds that it was to learn from")
    left_out: int = Field(description="clouds that could not be learnt from")


class Evaluated(BaseModel):
    """What a job that evaluates has found."""

    kind: Literal["evaluate"] = Field("evaluate", description="the kind of job")
    model: str = Field(description="name of the model")
    version: int = Field(ge=1, description="the version that was judged")
    metrics: dict[str, float] = Field(description="its figures, means over labels; 1 is best")
    clouds: int = Field(description="clouds that the figures are made of")
    unanswered: int = Field(description="clouds that the model refused; they are in no figure")
    reports: list[str] = Field(description="files of the report that can be fetched")


class Simulated(BaseModel):
    """What a job that simulates has made."""

    kind: Literal["simulate"] = Field("simulate", description="the kind of job")
    dataset: str = Field(description="that the clouds were added to")
    clouds: int = Field(description="clouds simulated")
    digest: str = Field(description="of the dataset's entries afterwards")


JobResult = Annotated[Trained | Evaluated | Simulated, Field(discriminator="kind")]
_RESULTS: TypeAdapter[Trained | Evaluated | Simulated] = TypeAdapter(JobResult)


class JobError(BaseModel):
    """Why a job failed."""

    type: str = Field(description="stable, kebab-case name of the error")
    detail: str = Field(description="what was wrong, and what to try")


class Job(BaseModel):
    """A job, as it stands."""

    id: str = Field(description="names the job")
    state: State = Field(description="queued, running, done, failed or cancelled")
    spec: Annotated[JobSpec, Field(discriminator="kind")] = Field(description="what it is to do")
    submitted: datetime = Field(description="UTC")
    started: datetime | None = Field(description="when a worker last took it, UTC")
    finished: datetime | None = Field(description="UTC")
    worker: str | None = Field(description="the worker that last took it")
    progress: Progress | None = Field(None, description="how far it is; null before it was begun, and when it is done")
    result: JobResult | None = Field(description="what it has made")
    error: JobError | None = Field(description="why it failed")

    @property
    def over(self) -> bool:
        """Whether nothing more is done about it."""
        return self.state in OVER


def read_job(status: WorkflowStatus, progress: Progress | None, begun: float | None = None) -> Job:
    """The job that is a workflow of the job engine.

    Args:
        status: as the engine tells it; of a cancelled job it forgets when that was taken.
        progress: how far it is.
        begun: when it was first taken, seconds since 1970.
    """
    state = ENGINE_STATES[status.status]
    inputs: Any = status.input
    return Job(
        id=status.workflow_id,
        state=state,
        spec=read_spec(inputs["args"][0]),
        submitted=_time(status.created_at) or datetime.now(UTC),
        started=_time(status.dequeued_at) or (None if begun is None else datetime.fromtimestamp(begun, UTC)),
        finished=_time(status.completed_at),
        worker=status.executor_id if state != "queued" else None,
        progress=progress if state != "done" else None,
        result=_RESULTS.validate_python(status.output) if state == "done" else None,
        error=_error(status) if state == "failed" else None,
    )


def _error(status: WorkflowStatus) -> JobError:
    if status.status != "ERROR":
        return JobError(type="internal", detail="It was begun too often without coming to an end.")
    name, detail = getattr(status.error, "name", type(status.error).__name__), str(status.error)
    known = getattr(errors, name, None)
    if isinstance(known, type) and issubclass(known, ShapeConceptsError):
        return JobError(type=known.type_name(), detail=detail)
    return JobError(type="internal", detail=f"Something unexpected went wrong: {name}. The worker's log says more.")


def _time(milliseconds: int | None) -> datetime | None:
    return None if milliseconds is None else datetime.fromtimestamp(milliseconds / 1000, UTC)
