"""What a model's training objects look like, several in one picture, and what people say that they are."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends, Query, Response

from service.application import Application
from service.clouds import png
from service.looking import ON_A_SHEET, ObjectLabels
from service.transports.rest import caching, model_examples
from service.transports.rest.caching import LASTING, IfNoneMatch, tagged_by_content
from service.transports.rest.problems import documented
from service.transports.rest.queries import Name, Reference, Version, known_only

Numbers = Annotated[
    list[Annotated[int, Query(ge=0, le=2**31)]],
    Query(
        min_length=1,
        max_length=ON_A_SHEET,
        description="of the training objects, from left to right",
        examples=[[17, 70]],
    ),
]


def router(application: Application) -> APIRouter:
    """The operations, for an application."""
    routes = APIRouter(prefix="/v1/models", tags=["models"], dependencies=[Depends(known_only)])

    @routes.get(
        "/{name}/versions/{version}/objects.png",
        summary="What do training objects look like?",
        response_class=Response,
        responses={**documented({}, 404, 422, 500, 503), 200: {"content": {png.MEDIA_TYPE: {}}}},
    )
    def sheet(name: Name, version: Version, number: Numbers) -> Response:
        """Training objects as the sensor saw them, 48 x 48 pixels each, side by side."""
        picture = png.write(application.looking.sheet(name, version, number))
        return Response(picture, headers={"Cache-Control": LASTING}, media_type=png.MEDIA_TYPE)

    @routes.get(
        "/{model}/labels",
        summary="What do people say that the training objects are?",
        response_model=ObjectLabels,
        responses={**documented(model_examples.LABELS, 404, 422, 500, 503), **caching.DOCUMENTED},
    )
    def labels(model: Reference, if_none_match: IfNoneMatch = None) -> Response:
        """The categories of those that came from datasets with labels; models learn without them."""
        return tagged_by_content(application.looking.labels(*application.which(model)), if_none_match)

    return routes
