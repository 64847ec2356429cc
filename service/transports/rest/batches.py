"""POST /v1/responses/batch: several clouds in, the concepts of each out."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

from fastapi import APIRouter, Depends, Request, Response
from pydantic import BaseModel, Field

from service.answer import Answer
from service.application import Application, CloudFile, parse_viewpoint
from service.clouds import UNITS, Viewpoint, by_media_type
from service.clouds.claims import quote
from service.engine.errors import InvalidParameter, ShapeConceptsError
from service.transports import errors
from service.transports.arriving import limits_of
from service.transports.detail import parse_detail
from service.transports.rest import model_examples
from service.transports.rest.access import caller_of
from service.transports.rest.detail import DetailQuery, as_json
from service.transports.rest.problems import Problem, documented
from service.transports.rest.queries import (
    AliasQuery,
    ModelQuery,
    TimeQuery,
    TopQuery,
    UnitQuery,
    VersionQuery,
    ViewpointQuery,
    known_only,
)
from service.transports.rest.uploads import Upload, receive_clouds, several

log = logging.getLogger(__name__)


class Item(BaseModel):
    """What is said of one cloud of several: an answer, or why there is none."""

    file: str = Field(description="name of its file as it was sent, empty if it had none")
    answer: Answer | None = Field(
        None, description="as POST /v1/responses gives it", exclude_if=lambda value: value is None
    )
    problem: Problem | None = Field(
        None, description="as POST /v1/responses gives it", exclude_if=lambda value: value is None
    )


class BatchAnswer(BaseModel):
    """What is said of several clouds."""

    model: str = Field(description="name of the model that answered all of them")
    version: int = Field(ge=1, description="its version")
    items: list[Item] = Field(description="one for each cloud, in the order in which they were sent")


def router(application: Application) -> APIRouter:
    """The operation, for an application."""
    routes = APIRouter(prefix="/v1", tags=["responses"], dependencies=[Depends(known_only)])
    settings = application.settings

    @routes.post(
        "/responses/batch",
        summary="Which concepts does each of several clouds resemble?",
        responses=documented(model_examples.BATCH, 400, 404, 408, 413, 415, 422, 429, 500, 503),
        response_model=BatchAnswer,
        openapi_extra={"requestBody": several(settings.max_batch)},
    )
    async def respond_to_batch(
        request: Request,
        model: ModelQuery = None,
        version: VersionQuery = None,
        alias: AliasQuery = None,
        time: TimeQuery = None,
        top: TopQuery = None,
        unit: UnitQuery = None,
        viewpoint: ViewpointQuery = None,
        detail: DetailQuery = None,
    ) -> Response:
        """Describes each cloud alone, all with one version of the model; parameters are as of one cloud.

        A cloud that cannot be answered keeps no other from its answer. A batch takes one place among the requests that
        wait: its clouds are answered one after another, and several at once only while the service has nothing else
        to do. Against the rate of an access key it counts as many as it has clouds.
        """
        frame = parse_frame(unit, viewpoint)
        parts = parse_detail(detail)
        caller = caller_of(request)
        with application.intake.opened() as take:
            uploads = await receive_clouds(request, limits_of(settings, caller), take, caller.max_batch)
            with application.pool.admitted():
                caller.spend(len(uploads))
                name, number = await application.pool.run(application.prepare, model, version, alias)
                respond = partial(
                    application.respond,
                    model=name,
                    version=number,
                    time=time,
                    top=top,
                    stimuli=parts.stimuli,
                    explain=parts.explanation,
                    segments=parts.segments,
                    max_points=caller.max_points,
                )
                attempt = partial(answer_each, respond, frame, request.state.id)
                items = await application.pool.run_each(attempt, uploads, request.is_disconnected)
                document = BatchAnswer(model=name, version=number, items=items)
                exclude: Any = {"items": {"__all__": {"answer": parts.exclude()}}}
                return await application.pool.run(as_json, document, exclude)

    return routes


class Frame(NamedTuple):
    """What is said once of all clouds; None where each says so itself."""

    unit: str | None
    viewpoint: Viewpoint | None


def parse_frame(unit: str | None, viewpoint: str | None) -> Frame:
    """The unit and the viewpoint of all clouds.

    Raises:
        InvalidParameter: they are none; it is said once, not of each cloud.
    """
    if unit is not None and unit not in UNITS:
        raise InvalidParameter(f"The unit is one of {', '.join(UNITS)}; it was {quote(unit)}.")
    return Frame(unit, None if viewpoint is None else parse_viewpoint(viewpoint))


def answer_each(respond: Callable[[CloudFile], Answer], frame: Frame, request_id: str, one: Upload) -> Item:
    """What is said of one cloud of several; nothing that is wrong with it is raised.

    Args:
        respond: answers a cloud.
        frame: of all clouds.
        request_id: of the whole.
        one: the cloud.
    """
    try:
        cloud = CloudFile(one.data, by_media_type(one.media_type), one.name, *frame)
        return Item(file=one.name, answer=respond(cloud))
    except ShapeConceptsError as error:
        return Item(file=one.name, problem=Problem(**errors.problem_of(error, request_id)))
    except Exception as error:
        log.error("%s: unexpected", request_id, exc_info=error)
        detail = "The service failed unexpectedly; its log says more under the id of this request."
        document = errors.problem("internal", errors.INTERNAL.title, errors.INTERNAL.http, detail, request_id)
        return Item(file=one.name, problem=Problem(**document))
