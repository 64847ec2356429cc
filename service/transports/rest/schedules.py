"""/v1/schedules: jobs that are submitted again and again, at the times of a cron expression."""

from __future__ import annotations

import json
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Path, Request, Response
from fastapi.concurrency import run_in_threadpool
from pydantic import BaseModel, ConfigDict, Field, JsonValue

from service.application import Application
from service.cron import LONGEST
from service.job_specs import read_spec
from service.model_file import NAME
from service.schedules import LONGEST_NAME, Schedule
from service.transports.arriving import limits_of
from service.transports.rest import caching
from service.transports.rest.access import caller_of
from service.transports.rest.caching import IfNoneMatch, tagged_by_content
from service.transports.rest.problems import documented, refused
from service.transports.rest.queries import known_only
from service.transports.rest.uploads import receive_json

ScheduleName = Annotated[
    str, Path(pattern=f"^{NAME}$", max_length=LONGEST_NAME, description="of the schedule", examples=["weekly"])
]
SCHEDULE: dict[str, Any] = {
    "name": "weekly",
    "cron": "0 3 * * mon",
    "zone": "Europe/Berlin",
    "job": {"name": "default", "extend": "default", "datasets": ["scans"]},
}


MADE: dict[str, Any] = {
    "name": "weekly",
    "cron": "0 3 * * mon",
    "zone": "Europe/Berlin",
    "state": "active",
    "since": "2026-11-22T13:00:00Z",
    "next_due": "2026-11-23T02:00:00Z",
    "last_due": None,
    "last_job": None,
    "fault": None,
    "job": {"kind": "train", "name": "default", "extend": "default", "datasets": ["scans"]},
}


class NewSchedule(BaseModel):
    """A schedule to be made."""

    model_config = ConfigDict(extra="forbid")

    name: str = Field(max_length=LONGEST_NAME, description="lower-case letters, digits and hyphens")
    cron: str = Field(max_length=LONGEST, description="minute, hour, day of month, month, day of week")
    zone: str = Field("UTC", max_length=60, description="IANA name of the time zone, as Europe/Berlin")
    job: dict[str, JsonValue] = Field(description="what each job is to do, as jobs are submitted")


class ScheduleList(BaseModel):
    """The schedules."""

    schedules: list[Schedule] = Field(description="by name")


def router(application: Application) -> APIRouter:
    """The operations, for an application."""
    routes = APIRouter(prefix="/v1/schedules", tags=["schedules"], dependencies=[Depends(known_only)])
    scheduling, settings = application.scheduling, application.settings

    @routes.get(
        "",
        summary="Which jobs are submitted again and again?",
        response_model=ScheduleList,
        responses={**documented({"schedules": [MADE]}, 422, 500, 503), **caching.DOCUMENTED},
    )
    def schedules(if_none_match: IfNoneMatch = None) -> Response:
        """All schedules, when they are next due, and the jobs that they have submitted last."""
        return tagged_by_content(ScheduleList(schedules=scheduling.schedules()), if_none_match)

    @routes.post(
        "",
        status_code=201,
        summary="Have a job submitted at the times of a cron expression",
        response_model=Schedule,
        responses={
            201: {"content": {"application/json": {"example": json.dumps(MADE)}}},
            **refused(400, 404, 408, 409, 413, 415, 422, 429, 500, 503),
        },
        openapi_extra={
            "requestBody": {
                "required": True,
                "content": {"application/json": {"schema": NewSchedule.model_json_schema(), "example": SCHEDULE}},
            }
        },
    )
    async def create(request: Request) -> Schedule:
        """Workers submit the job at each of these times, once. Times at which none ran are made good by one job.

        Made again with the same times and job, it is the same schedule.
        """
        with application.intake.opened() as take:
            new = await receive_json(request, limits_of(settings, caller_of(request)), take, NewSchedule)
        return await run_in_threadpool(scheduling.create, new.name, new.cron, read_spec(dict(new.job)), new.zone)

    @routes.get(
        "/{name}",
        summary="How does a schedule stand?",
        response_model=Schedule,
        responses={**documented(MADE, 404, 422, 500, 503), **caching.DOCUMENTED},
    )
    def schedule(name: ScheduleName, if_none_match: IfNoneMatch = None) -> Response:
        """What it submits, when it is next due, and what it has submitted last."""
        return tagged_by_content(scheduling.schedule(name), if_none_match)

    @routes.post("/{name}/pause", summary="Submit nothing", responses=documented(MADE, 404, 422, 500, 503))
    def pause(name: ScheduleName) -> Schedule:
        """Until it is resumed. Repeated, it is done once."""
        return scheduling.pause(name)

    @routes.post("/{name}/resume", summary="Submit again", responses=documented(MADE, 404, 422, 500, 503))
    def resume(name: ScheduleName) -> Schedule:
        """At times later than now; those of the pause count for nothing. Repeated, it is done once."""
        return scheduling.resume(name)

    @routes.delete("/{name}", summary="Remove a schedule", responses=documented(MADE, 404, 422, 500, 503))
    def delete(name: ScheduleName) -> Schedule:
        """Jobs that it has submitted stay. The answer is what it was."""
        return scheduling.delete(name)

    return routes
