"""Messages of JobsService <-> what the use cases on jobs take and give."""

from __future__ import annotations

from typing import Any

from google.protobuf.json_format import MessageToDict
from google.protobuf.struct_pb2 import Struct
from google.protobuf.timestamp_pb2 import Timestamp

from service.engine.errors import InvalidParameter
from service.job import STATES, Job, State
from service.job_records import LogLine
from service.job_specs import JobSpec, read_spec
from service.jobs import Look
from service.transports.grpc.generated.shapeconcepts.v1 import jobs_pb2


def to_spec(message: jobs_pb2.JobSpec) -> JobSpec:
    """The job that is asked for.

    Raises:
        InvalidParameter: there cannot be such a job.
    """
    work = message.WhichOneof("work")
    if work is None:
        raise InvalidParameter("A job trains, evaluates or simulates: set one of train, evaluate and simulate.")
    given: dict[str, Any] = MessageToDict(getattr(message, work), preserving_proto_field_name=True)
    if given.get("alias") == "":
        given["alias"] = None
    if "promote" in given:
        given["promote"] = str(given["promote"]).removeprefix("PROMOTION_").replace("_", "-").lower()
    if message.HasField("timeout_s"):
        given["timeout"] = message.timeout_s
    if message.HasField("attempts"):
        given["attempts"] = message.attempts
    return read_spec({"kind": work} | given)


def to_state(message: int) -> State | None:
    """The state that is meant; None for none.

    Raises:
        InvalidParameter: there is none of that number.
    """
    if not 0 <= message <= len(STATES):
        raise InvalidParameter(f"There is no state of the number {message}.")
    return STATES[message - 1] if message else None


def from_job(job: Job) -> jobs_pb2.Job:
    """A job as it stands."""
    message = jobs_pb2.Job(
        id=job.id,
        state=jobs_pb2.JobState.Value(f"JOB_STATE_{job.state.upper()}"),
        spec=_struct(job.spec.model_dump(mode="json")),
        submitted=job.submitted,
        started=job.started,
        finished=job.finished,
        worker=job.worker or "",
    )
    if job.progress is not None:
        message.progress.CopyFrom(jobs_pb2.JobProgress(**job.progress.model_dump()))
    if job.result is not None:
        message.result.CopyFrom(_struct(job.result.model_dump(mode="json")))
    if job.error is not None:
        message.error.CopyFrom(jobs_pb2.JobError(**job.error.model_dump()))
    return message


def from_look(look: Look) -> jobs_pb2.WatchResponse:
    """What is new of a job."""
    return jobs_pb2.WatchResponse(job=from_job(look.job), lines=[_from_line(line) for line in look.lines])


def _from_line(line: LogLine) -> jobs_pb2.LogLine:
    at = Timestamp()
    at.FromMicroseconds(round(line.at * 1e6))
    return jobs_pb2.LogLine(number=line.number, at=at, line=line.line)


def _struct(values: dict[str, Any]) -> Struct:
    struct = Struct()
    struct.update(values)
    return struct
