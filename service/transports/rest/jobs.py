"""/v1/jobs: submit jobs, see how they stand, follow them, cancel them, let them go on."""

from __future__ import annotations

import json
import time
from collections.abc import AsyncIterator
from datetime import UTC, datetime
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Header, Path, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import StreamingResponse
from pydantic import BaseModel, Field, RootModel
from starlette.types import Receive, Scope, Send

from service.application import Application
from service.job import Job, State
from service.job_records import LogLine
from service.job_specs import LONGEST, JobSpec
from service.jobs import Look
from service.model_file import NAME
from service.training import Training
from service.transports.arriving import limits_of
from service.transports.following import follow
from service.transports.rest import caching, job_examples
from service.transports.rest.access import caller_of
from service.transports.rest.caching import IfNoneMatch, tagged_by_content
from service.transports.rest.problems import documented
from service.transports.rest.queries import known_only
from service.transports.rest.uploads import receive_json

KEEP_ALIVE = 15.0  # seconds of silence after which followers are told that there is nothing new
RECONNECT = 1000  # milliseconds after which a follower that lost the connection asks again
LINES = 1000  # of a log in one answer
HARMLESS = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; sandbox"

JobId = Annotated[
    str, Path(pattern=f"^{NAME}$", max_length=LONGEST, description="of the job", examples=["nightly-2025-01-31"])
]
LastLine = Annotated[int, Query(ge=0, le=2**31, description="number of the last line of the log that was seen")]


class Submission(RootModel[Annotated[JobSpec, Field(discriminator="kind")]]):
    """A job that is asked for: one that trains, evaluates or simulates."""


class JobList(BaseModel):
    """Jobs."""

    jobs: list[Job] = Field(description="the one submitted last first")
    next: str | None = Field(description="what to give as `before` for the next page; null if there is none")


class Line(BaseModel):
    """A line of a job's log."""

    number: int = Field(ge=1, description="counts up from 1")
    at: datetime = Field(description="UTC")
    line: str = Field(description="the text")


class Log(BaseModel):
    """The log of a job."""

    job: str = Field(description="id of the job")
    lines: list[Line] = Field(description="oldest first, 1000 at most: ask for those after the last")


class _Events(StreamingResponse):
    """Server-sent events, one client among those who follow jobs for as long as they last."""

    def __init__(self, training: Training, content: AsyncIterator[str]) -> None:
        headers = {"Cache-Control": "no-cache", "X-Accel-Buffering": "no"}
        super().__init__(content, headers=headers, media_type="text/event-stream")
        self._training = training

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        with self._training.following():
            await super().__call__(scope, receive, send)


def router(application: Application) -> APIRouter:
    """The operations, for an application."""
    routes = APIRouter(prefix="/v1/jobs", tags=["jobs"], dependencies=[Depends(known_only)])
    training, settings = application.training, application.settings

    @routes.post(
        "",
        status_code=202,
        summary="Submit a job",
        responses=_accepted(400, 404, 408, 413, 415, 422, 429, 500, 503),
        openapi_extra={
            "requestBody": {
                "required": True,
                "content": {
                    "application/json": {
                        "schema": {"$ref": "#/components/schemas/Submission"},
                        "examples": job_examples.SUBMISSIONS,
                    }
                },
            }
        },
    )
    async def submit(
        request: Request,
        response: Response,
        idempotency_key: Annotated[
            str | None,
            Header(
                max_length=LONGEST + 2,
                description="becomes the job's id, lower-case letters, digits and hyphens: a request that is repeated "
                "with it is one job; with another job it is refused. By default a random UUID",
            ),
        ] = None,
    ) -> Job:
        """Puts a job into the queue; a worker takes it, and its state, progress and result can be asked for."""
        with application.intake.opened() as take:
            given = await receive_json(request, limits_of(settings, caller_of(request)), take, Submission)
        key = None if idempotency_key is None else idempotency_key.strip('"')
        job = await run_in_threadpool(training.submit, given.root, key)
        response.headers["Location"] = f"/v1/jobs/{job.id}"
        return job

    @routes.get(
        "",
        summary="Which jobs are there?",
        response_model=JobList,
        responses={**documented(job_examples.JOBS, 404, 422, 500, 503), **caching.DOCUMENTED},
    )
    def jobs(
        limit: Annotated[int, Query(ge=1, le=100, description="how many at most")] = 20,
        before: Annotated[
            str | None,
            Query(pattern=f"^{NAME}$", max_length=LONGEST, description="id of a job: those submitted before it"),
        ] = None,
        state: Annotated[State | None, Query(description="of the jobs; by default all")] = None,
        if_none_match: IfNoneMatch = None,
    ) -> Response:
        """The jobs, the one submitted last first, page by page."""
        page = training.jobs(limit, before, state)
        return tagged_by_content(JobList(jobs=page.jobs, next=page.next), if_none_match)

    @routes.get(
        "/{job}",
        summary="How does a job stand?",
        response_model=Job,
        responses={**documented(job_examples.JOB, 404, 422, 500, 503), **caching.DOCUMENTED},
    )
    def show(job: JobId, if_none_match: IfNoneMatch = None) -> Response:
        """Its state, how far it is with an estimate of the time left, and what it has made or why it failed."""
        return tagged_by_content(training.job(job), if_none_match)

    @routes.get(
        "/{job}/logs",
        summary="What does a job's log say?",
        response_model=Log,
        responses={**documented(job_examples.LOG, 404, 422, 500, 503), **caching.DOCUMENTED},
    )
    def logs(job: JobId, after: LastLine = 0, if_none_match: IfNoneMatch = None) -> Response:
        """Its lines, oldest first."""
        lines = [_line(line) for line in training.look(job, after).lines]
        return tagged_by_content(Log(job=job, lines=lines), if_none_match)

    @routes.get(
        "/{job}/events",
        summary="Follow a job",
        response_class=StreamingResponse,
        responses={
            **documented({}, 404, 422, 429, 500, 503),
            200: {
                "description": "Server-sent events",
                "content": {"text/event-stream": {"schema": {"type": "string"}}},
            },
        },
    )
    def events(
        job: JobId,
        last_event_id: Annotated[
            str | None,
            Header(pattern="^[0-9]{0,9}$", description="id of the last event that was seen, sent when reconnecting"),
        ] = None,
        after: LastLine = 0,
    ) -> Response:
        """Server-sent events until the job is over.

        `log` is a line of the log, and its id the line's number: whoever reconnects with `Last-Event-ID` misses none.
        `job` is the job as it stands, at first and whenever something of it has changed. `end` says that it is over,
        and that there is nothing to reconnect for.
        """
        training.job(job)
        return _Events(training, _told(training, job, int(last_event_id or after)))

    @routes.post(
        "/{job}/cancel",
        summary="Cancel a job",
        responses=documented(job_examples.CANCELLED, 404, 422, 500, 503),
    )
    def cancel(job: JobId) -> Job:
        """Takes it from the queue, or stops it within seconds; one that is over stays as it is."""
        return training.cancel(job)

    @routes.post(
        "/{job}/retry",
        summary="Let a job go on",
        responses=documented(job_examples.RETRIED, 404, 409, 422, 500, 503),
    )
    def retry(job: JobId) -> Job:
        """A job that failed or was cancelled goes on with the stage at which it ended."""
        return training.retry(job)

    @routes.get(
        "/{job}/report.json",
        summary="What does an evaluation say?",
        responses={**documented({}, 404, 422, 500, 503), 200: {"content": {"application/json": {"example": {}}}}},
    )
    def report(job: JobId) -> Response:
        """The report of a job that has evaluated, for programs."""
        return Response(training.report(job, "report.json").data, media_type="application/json")

    @routes.get(
        "/{job}/report.html",
        summary="What does an evaluation say, as a page?",
        response_class=Response,
        responses={**documented({}, 404, 422, 500, 503), 200: {"content": {"text/html": {}}}},
    )
    def page(job: JobId) -> Response:
        """The report of a job that has evaluated, for people: one file without scripts."""
        found = training.report(job, "report.html")
        return Response(found.data, headers={"Content-Security-Policy": HARMLESS}, media_type=found.media_type)

    return routes


def _accepted(*statuses: int) -> dict[int | str, dict[str, Any]]:
    described = documented(job_examples.QUEUED, *statuses)
    return {202 if status == 200 else status: answer for status, answer in described.items()}


async def _told(training: Training, job: str, after: int) -> AsyncIterator[str]:
    """The events of a job."""
    yield f"retry: {RECONNECT}\n\n"
    seen: Job | None = None
    said = time.monotonic()
    async for look in follow(training, job, after):
        if look is not None:
            yield _events(look, seen)
            seen, said = look.job, time.monotonic()
        elif time.monotonic() - said > KEEP_ALIVE:
            yield ": nothing new\n\n"
            said = time.monotonic()
    if seen is not None and seen.over:
        yield f"event: end\ndata: {json.dumps({'state': seen.state})}\n\n"


def _events(look: Look, seen: Job | None) -> str:
    """What is new of a job: lines first, so that the state that they led to comes after them."""
    lines = "".join(f"event: log\nid: {line.number}\ndata: {_line(line).model_dump_json()}\n\n" for line in look.lines)
    changed = look.job != seen
    return lines + (f"event: job\ndata: {look.job.model_dump_json()}\n\n" if changed else "")


def _line(line: LogLine) -> Line:
    return Line(number=line.number, at=datetime.fromtimestamp(line.at, UTC), line=line.line)
