"""The one table of error codes: what each error is in HTTP and in gRPC, and the document that describes it.

The document is that of RFC 9457 (problem details), the same on every transport: the body of an HTTP answer, a
detail of a gRPC status, the payload of a zenoh error reply.
"""

from __future__ import annotations

import math
import re
from typing import Any, NamedTuple

from service.engine.errors import (
    ArchiveTooLarge,
    Cancelled,
    CloudExists,
    CloudNotFound,
    ClusterUnavailable,
    ConceptNotFound,
    ContentTooLarge,
    DatasetDamaged,
    DatasetExists,
    DatasetInUse,
    DatasetNotFound,
    InvalidCloud,
    InvalidParameter,
    JobConflict,
    JobNotFound,
    JobsUnavailable,
    JobTimedOut,
    KeyNotFound,
    ModelDamaged,
    ModelIncompatible,
    ModelNotFound,
    NotAllowed,
    NotAuthenticated,
    NotEnoughSamples,
    Overloaded,
    RateExceeded,
    RendererUnavailable,
    ScheduleExists,
    ScheduleNotFound,
    ShapeConceptsError,
    StageDied,
    StoreUnavailable,
    StreamNotFound,
    StreamsUnavailable,
    TooManyPoints,
    UnreadableArchive,
    UnreadableCloud,
    UnsupportedFormat,
    UploadConflict,
    UploadNotFound,
)

MEDIA_TYPE = "application/problem+json"
RETRY_AFTER = 1  # seconds, where trying again may help and nothing tells when


class Status(NamedTuple):
    """What an error is called on the wires.

    Attributes:
        http: status code.
        grpc: name of the status code.
        title: the kind of error in words, the same for every occurrence.
        retry: seconds after which the same request may succeed; 0 where it will not.
        private: whether the message is for the operator's log alone, since it tells of the inside.
    """

    http: int
    grpc: str
    title: str
    retry: int = 0
    private: bool = False


TABLE: dict[type[ShapeConceptsError], Status] = {
    InvalidParameter: Status(422, "INVALID_ARGUMENT", "A parameter is out of its range"),
    UnreadableCloud: Status(400, "INVALID_ARGUMENT", "The cloud cannot be read"),
    UnsupportedFormat: Status(415, "INVALID_ARGUMENT", "The format of the cloud is not supported"),
    InvalidCloud: Status(422, "INVALID_ARGUMENT", "The cloud cannot be answered"),
    ContentTooLarge: Status(413, "RESOURCE_EXHAUSTED", "The body is too large"),
    TooManyPoints: Status(413, "INVALID_ARGUMENT", "The cloud has too many points"),
    NotEnoughSamples: Status(422, "FAILED_PRECONDITION", "There are too few clouds to learn from"),
    RendererUnavailable: Status(503, "FAILED_PRECONDITION", "There is no renderer"),
    ModelNotFound: Status(404, "NOT_FOUND", "There is no such model"),
    ConceptNotFound: Status(404, "NOT_FOUND", "There is no such concept"),
    ModelDamaged: Status(500, "DATA_LOSS", "The model is damaged"),
    ModelIncompatible: Status(500, "FAILED_PRECONDITION", "The model cannot be read by this version of the service"),
    StoreUnavailable: Status(
        503, "UNAVAILABLE", "The store of models is out of reach", retry=RETRY_AFTER, private=True
    ),
    DatasetNotFound: Status(404, "NOT_FOUND", "There is no such dataset"),
    DatasetExists: Status(409, "ALREADY_EXISTS", "There is another dataset of that name"),
    DatasetInUse: Status(409, "FAILED_PRECONDITION", "A model learnt from the dataset"),
    DatasetDamaged: Status(500, "DATA_LOSS", "The dataset is damaged"),
    CloudNotFound: Status(404, "NOT_FOUND", "There is no such cloud"),
    CloudExists: Status(409, "ALREADY_EXISTS", "There is another cloud of that key"),
    UnreadableArchive: Status(400, "INVALID_ARGUMENT", "The archive cannot be read"),
    ArchiveTooLarge: Status(413, "INVALID_ARGUMENT", "The archive is too large"),
    UploadNotFound: Status(404, "NOT_FOUND", "There is no such upload"),
    UploadConflict: Status(409, "ABORTED", "The piece does not follow"),
    JobNotFound: Status(404, "NOT_FOUND", "There is no such job"),
    JobConflict: Status(409, "FAILED_PRECONDITION", "The job is in another state"),
    JobTimedOut: Status(422, "FAILED_PRECONDITION", "The job took too long"),
    StageDied: Status(500, "INTERNAL", "A stage of the job was killed"),
    ScheduleNotFound: Status(404, "NOT_FOUND", "There is no such schedule"),
    ScheduleExists: Status(409, "ALREADY_EXISTS", "There is another schedule of that name"),
    StreamNotFound: Status(404, "NOT_FOUND", "There is no such stream"),
    StreamsUnavailable: Status(503, "UNAVAILABLE", "The streams are out of reach", retry=RETRY_AFTER),
    JobsUnavailable: Status(503, "UNAVAILABLE", "Jobs are out of reach", retry=RETRY_AFTER, private=True),
    ClusterUnavailable: Status(503, "UNAVAILABLE", "The cluster is out of reach", retry=RETRY_AFTER, private=True),
    NotAuthenticated: Status(401, "UNAUTHENTICATED", "An access key is needed"),
    NotAllowed: Status(403, "PERMISSION_DENIED", "The access key does not allow this"),
    KeyNotFound: Status(404, "NOT_FOUND", "There is no such access key"),
    RateExceeded: Status(429, "RESOURCE_EXHAUSTED", "The access key is used too much", retry=RETRY_AFTER),
    Overloaded: Status(429, "RESOURCE_EXHAUSTED", "The service has too much to do", retry=RETRY_AFTER),
    Cancelled: Status(499, "CANCELLED", "The request was cancelled"),
}
INTERNAL = Status(500, "INTERNAL", "Something unexpected went wrong")


def status_of(error: ShapeConceptsError) -> Status:
    """The status of an error: its class's, or the nearest base's that the table has."""
    status = next((TABLE[base] for base in type(error).__mro__ if base in TABLE), INTERNAL)
    if isinstance(error, RateExceeded):
        return status._replace(retry=max(status.retry, math.ceil(error.after)))
    return status


def problem(type_name: str, title: str, status: int, detail: str, request_id: str) -> dict[str, Any]:
    """A problem document of RFC 9457.

    Args:
        type_name: stable, kebab-case name of the error, e.g. "too-few-points".
        title: the kind of error in words.
        status: HTTP status code; the other transports send it as well.
        detail: what was wrong this time, and what to try.
        request_id: names the occurrence, as it is logged; a UUID, or what the client calls the request.
    """
    return {
        "type": f"urn:shape-concepts:error:{type_name}",
        "title": title,
        "status": status,
        "detail": detail,
        "instance": f"urn:uuid:{request_id}" if _is_uuid(request_id) else f"urn:shape-concepts:request:{request_id}",
    }


def _is_uuid(text: str) -> bool:
    return re.fullmatch(r"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}", text, re.IGNORECASE) is not None


def problem_of(error: ShapeConceptsError, request_id: str) -> dict[str, Any]:
    """The problem document of one of our errors."""
    status = status_of(error)
    known = (type(error).__doc__ or "").partition("\n")[0]
    detail = known if status.private else str(error) or known
    return problem(error.type_name(), status.title, status.http, detail, request_id)
