"""/v1/models: which models there are, how each was made, what it holds, and which version an alias means."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends, Path, Query, Response
from pydantic import BaseModel, Field

from service.application import Application
from service.catalogue import AnnexationGraph, Barcode, ConceptList, Tree
from service.clouds import png
from service.comparing import VersionComparison
from service.engine.errors import ModelNotFound
from service.model_cases import ModelSummary
from service.model_file import NAME, Manifest
from service.store import PRODUCTION
from service.transports.rest import caching, examples, model_examples
from service.transports.rest.caching import CHECKED, LASTING, IfNoneMatch, tag_of, tagged, tagged_by_content
from service.transports.rest.problems import documented
from service.transports.rest.queries import Name, Qualified, Reference, Version, known_only

Number = Annotated[int, Path(ge=0, le=2**31, description="of the training object, from 0", examples=[17])]
ConceptTime = Annotated[
    float | None,
    Query(
        ge=0,
        le=1,
        description="filtration time of all concepts: 0 specific, 1 generic; by default those that clouds are compared "
        "with: at epsilon_max, and of other times",
    ),
]
Alias = Annotated[str, Query(pattern=f"^{NAME}$", max_length=63, description="alias to move")]
Leaving = Annotated[
    int,
    Query(
        ge=1,
        le=99_999_999,
        description="version that the alias shall no longer mean; if it means another one, nothing happens, so that a "
        "request that is repeated is done once",
    ),
]

With = Annotated[
    str,
    Query(
        alias="with",
        pattern=f"^{NAME}(@{NAME}|:[0-9]{{1,8}})?$",
        max_length=127,
        description="version to which concepts go: NAME, NAME@ALIAS or NAME:VERSION",
        examples=["default:2"],
    ),
]


class ModelList(BaseModel):
    """The models of the store."""

    models: list[ModelSummary] = Field(description="by name")


class ModelMeant(ModelSummary):
    """A model, and which version of it is meant."""

    version: int | None = Field(description="that NAME, NAME@ALIAS or NAME:VERSION means; null for NAME if it has none")


class AliasChange(BaseModel):
    """A line of an alias's history."""

    version: int = Field(description="what it meant from then on")
    action: str = Field(description="promote or rollback")
    at: str = Field(description="UTC, ISO 8601")


class AliasHistories(BaseModel):
    """All that the aliases of a model have meant."""

    model: str = Field(description="name of the model")
    aliases: dict[str, list[AliasChange]] = Field(description="the history of each, oldest first: the last one holds")


class AliasMeaning(BaseModel):
    """What an alias means now."""

    model: str = Field(description="name of the model")
    alias: str = Field(description="the alias")
    version: int = Field(description="what it means")


def router(application: Application) -> APIRouter:
    """The operations, for an application."""
    routes = APIRouter(prefix="/v1/models", tags=["models"], dependencies=[Depends(known_only)])

    @routes.get(
        "",
        summary="Which models are there?",
        response_model=ModelList,
        responses={**documented(examples.MODELS, 422, 500, 503), **caching.DOCUMENTED},
    )
    def models(if_none_match: IfNoneMatch = None) -> Response:
        """Names, versions and aliases of all models of the store."""
        return tagged_by_content(ModelList(models=application.models.all()), if_none_match)

    @routes.get(
        "/{model}",
        summary="Which versions and aliases has a model?",
        response_model=ModelMeant,
        responses={**documented(model_examples.MODEL, 404, 422, 500, 503), **caching.DOCUMENTED},
    )
    def model(model: Reference, if_none_match: IfNoneMatch = None) -> Response:
        """Its versions and aliases, and which version is meant by the reference."""
        name = model.partition("@")[0].partition(":")[0]
        summary = application.models.one(name)
        try:
            version = application.which(model)[1]
        except ModelNotFound:
            if model != name:
                raise
            version = None
        return tagged_by_content(ModelMeant(**summary.model_dump(), version=version), if_none_match)

    @routes.get(
        "/{name}/versions/{version}",
        summary="How was a model made?",
        response_model=Manifest,
        responses={**documented(examples.MANIFEST, 404, 422, 500, 503), **caching.DOCUMENTED},
    )
    def manifest(name: Name, version: Version, if_none_match: IfNoneMatch = None) -> Response:
        """The manifest of a version: seed, parameters, source of the clouds, counts and content hashes."""
        found = application.models.manifest(name, version)
        return tagged(_tag(application, name, version), if_none_match, LASTING, lambda: found)

    @routes.get(
        "/{name}/versions/{version}/objects/{number}.png",
        summary="What does a training object look like?",
        response_class=Response,
        responses={**documented({}, 404, 422, 500, 503), 200: {"content": {png.MEDIA_TYPE: {}}}},
    )
    def thumbnail(name: Name, version: Version, number: Number) -> Response:
        """A training object as the sensor saw it, 48 x 48 pixels: explanations name it by its number."""
        headers = {"Cache-Control": LASTING}
        return Response(
            png.write(application.looking.thumbnail(name, version, number)), headers=headers, media_type=png.MEDIA_TYPE
        )

    @routes.get(
        "/{name}/versions/{version}/compare",
        summary="What became of a version's concepts in another one?",
        response_model=VersionComparison,
        responses={**documented(model_examples.COMPARISON, 404, 422, 429, 500, 503), **caching.DOCUMENTED},
    )
    async def compare(name: Name, version: Version, other: With, if_none_match: IfNoneMatch = None) -> Response:
        """Which concepts persist, merge, split or disappear, and which appear.

        Versions are compared by the clouds that both learnt from, and by asking each about what the other one recalls
        of its own: that may take seconds.
        """
        with application.pool.admitted():
            return await application.pool.run(_compare, application, (name, version), other, if_none_match)

    @routes.get(
        "/{model}/concepts",
        summary="Which concepts did a model learn?",
        response_model=ConceptList,
        responses={**documented(model_examples.CONCEPTS, 404, 422, 500, 503), **caching.DOCUMENTED},
    )
    def concepts(model: Reference, time: ConceptTime = None, if_none_match: IfNoneMatch = None) -> Response:
        """Their sizes, names and prototypes: key, hash, picture and place on the map of each training object."""
        name, version = application.which(model)
        tag = _tag(application, name, version, time, application.naming.names(name, version).changes)
        return tagged(tag, if_none_match, CHECKED, lambda: application.models.concepts(name, version, time))

    @routes.get(
        "/{model}/barcode",
        summary="When do components die?",
        response_model=Barcode,
        responses={**documented(model_examples.BARCODE, 404, 422, 500, 503), **caching.DOCUMENTED},
    )
    def barcode(model: Reference, if_none_match: IfNoneMatch = None) -> Response:
        """The bars of H_0 of the filtration."""
        name, version = application.which(model)
        tag, control = _tag(application, name, version), _control(model)
        return tagged(tag, if_none_match, control, lambda: application.models.barcode(name, version))

    @routes.get(
        "/{model}/annexations",
        summary="Which component took in which, and when?",
        response_model=AnnexationGraph,
        responses={**documented(model_examples.ANNEXATIONS, 404, 422, 500, 503), **caching.DOCUMENTED},
    )
    def annexations(model: Reference, if_none_match: IfNoneMatch = None) -> Response:
        """The annexation graph F of the filtration."""
        name, version = application.which(model)
        tag, control = _tag(application, name, version), _control(model)
        return tagged(tag, if_none_match, control, lambda: application.models.annexations(name, version))

    @routes.get(
        "/{model}/tree",
        summary="How are the training objects joined?",
        response_model=Tree,
        responses={**documented(model_examples.TREE, 404, 422, 500, 503), **caching.DOCUMENTED},
    )
    def tree(model: Reference, if_none_match: IfNoneMatch = None) -> Response:
        """The spanning tree of the topological space: its edges, their divergences, and how hot each vertex is."""
        name, version = application.which(model)
        tag, control = _tag(application, name, version), _control(model)
        return tagged(tag, if_none_match, control, lambda: application.models.tree(name, version))

    @routes.get(
        "/{name}/aliases",
        summary="What have a model's aliases meant?",
        response_model=AliasHistories,
        responses={**documented(model_examples.ALIASES, 404, 422, 500, 503), **caching.DOCUMENTED},
    )
    def aliases(name: Name, if_none_match: IfNoneMatch = None) -> Response:
        """The history of each alias."""
        changes = {
            alias: [AliasChange(**entry._asdict()) for entry in entries]
            for alias, entries in application.models.histories(name).items()
        }
        return tagged_by_content(AliasHistories(model=name, aliases=changes), if_none_match)

    @routes.post(
        "/{model}/promote",
        summary="Let an alias mean a version",
        responses=documented(model_examples.PROMOTED, 404, 422, 500, 503),
    )
    def promote(model: Qualified, alias: Alias = PRODUCTION) -> AliasMeaning:
        """The version is named as NAME:VERSION, or by another alias as NAME@ALIAS. Repeated, it is done once."""
        name, version = application.models.promote(model, alias)
        return AliasMeaning(model=name, alias=alias, version=version)

    @routes.post(
        "/{name}/rollback",
        summary="Let an alias mean what it meant before",
        responses=documented(model_examples.ROLLED_BACK, 404, 422, 500, 503),
    )
    def rollback(name: Name, leaving: Leaving, alias: Alias = PRODUCTION) -> AliasMeaning:
        """What it meant before its last promotion. The answer says what it means then, whether it was moved or not."""
        version = application.models.rollback(name, alias, leaving)
        return AliasMeaning(model=name, alias=alias, version=version)

    return routes


def _compare(application: Application, old: tuple[str, int], other: str, if_none_match: str | None) -> Response:
    new = application.which(other)
    names = [application.naming.names(*which).changes for which in (old, new)]
    tag = tag_of(_tag(application, *old), _tag(application, *new), *names)
    return tagged(tag, if_none_match, CHECKED, lambda: application.models.compare(old, new))


def _tag(application: Application, name: str, version: int, *more: object) -> str:
    """The tag of what a version says of itself: by the hash of its content, and by what else plays a part."""
    manifest = application.models.manifest(name, version)
    return tag_of(name, version, manifest.digest, manifest.created, *more)


def _control(reference: str) -> str:
    """How long an answer about a model lasts: what NAME:VERSION means never changes, what an alias means does."""
    return LASTING if ":" in reference else CHECKED
