"""GET /v1/models: which models there are, and how each was made."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends, Path, Response
from pydantic import BaseModel, Field

from service.application import Application, ModelSummary
from service.model_file import NAME, Manifest
from service.pictures import MEDIA_TYPE, png
from service.transports.rest import examples
from service.transports.rest.problems import documented
from service.transports.rest.queries import known_only

Name = Annotated[str, Path(pattern=f"^{NAME}$", max_length=63, description="of the model", examples=["default"])]
Version = Annotated[int, Path(ge=1, le=99_999_999, description="of the model", examples=[1])]
Number = Annotated[int, Path(ge=0, le=2**31, description="of the training object, from 0", examples=[17])]


class ModelList(BaseModel):
    """The models of the store."""

    models: list[ModelSummary] = Field(description="by name")


def router(application: Application) -> APIRouter:
    """The operations, for an application."""
    routes = APIRouter(prefix="/v1/models", tags=["models"], dependencies=[Depends(known_only)])

    @routes.get(
        "",
        summary="Which models are there?",
        responses=documented(examples.MODELS, 422, 500, 503),
    )
    def models() -> ModelList:
        """Names, versions and aliases of all models of the store."""
        return ModelList(models=application.models())

    @routes.get(
        "/{name}/versions/{version}",
        summary="How was a model made?",
        responses=documented(examples.MANIFEST, 404, 422, 500, 503),
    )
    def manifest(name: Name, version: Version) -> Manifest:
        """The manifest of a version: seed, parameters, source of the clouds, counts and content hashes."""
        return application.manifest(name, version)

    @routes.get(
        "/{name}/versions/{version}/objects/{number}.png",
        summary="What does a training object look like?",
        response_class=Response,
        responses={**documented({}, 404, 422, 500, 503), 200: {"content": {MEDIA_TYPE: {}}}},
    )
    def thumbnail(name: Name, version: Version, number: Number) -> Response:
        """A training object as the sensor saw it, 48 x 48 pixels: explanations name it by its number."""
        return Response(png(application.thumbnail(name, version, number)), media_type=MEDIA_TYPE)

    return routes
