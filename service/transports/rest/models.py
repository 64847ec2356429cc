"""GET /v1/models: which models there are, and how each was made."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends, Path
from pydantic import BaseModel, Field

from service.application import Application, ModelSummary
from service.model_file import NAME, Manifest
from service.transports.rest import examples
from service.transports.rest.problems import documented
from service.transports.rest.queries import known_only


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
    def manifest(
        name: Annotated[
            str, Path(pattern=f"^{NAME}$", max_length=63, description="of the model", examples=["default"])
        ],
        version: Annotated[int, Path(ge=1, le=99_999_999, description="of the model", examples=[1])],
    ) -> Manifest:
        """The manifest of a version: seed, parameters, source of the clouds, counts and content hashes."""
        return application.manifest(name, version)

    return routes
