"""Names of concepts: give, take away, look back, and have some proposed from labelled clouds."""

from __future__ import annotations

from functools import partial
from typing import Annotated

from fastapi import APIRouter, Depends, Path, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from pydantic import BaseModel, ConfigDict, Field

from service.application import Application
from service.carrying import CarriedName
from service.model_file import NAME
from service.names import LONGEST, check_concept_name
from service.proposals import Proposal
from service.transports.arriving import limits_of
from service.transports.rest import caching, model_examples
from service.transports.rest.access import caller_of
from service.transports.rest.batches import Item, answer_each, parse_frame
from service.transports.rest.caching import IfNoneMatch, tagged_by_content
from service.transports.rest.problems import Problem, documented
from service.transports.rest.queries import Reference, UnitQuery, ViewpointQuery, known_only
from service.transports.rest.uploads import receive_clouds, receive_json, several

ConceptId = Annotated[
    int,
    Path(ge=0, le=2**31, description="of the concept, as answers give it: a node of the merge tree", examples=[433]),
]
NameTime = Annotated[
    float | None,
    Query(ge=0, le=1, description="filtration time of the concepts that are named; by default the model's epsilon_max"),
]

NamesFrom = Annotated[
    str,
    Query(
        alias="from",
        pattern=f"^{NAME}(@{NAME}|:[0-9]{{1,8}})?$",
        max_length=127,
        description="version that has names: NAME, NAME@ALIAS or NAME:VERSION",
        examples=["default:1"],
    ),
]


class GivenName(BaseModel):
    """What a concept shall be called."""

    model_config = ConfigDict(extra="forbid")

    name: str = Field(min_length=1, max_length=LONGEST, description="visible characters", examples=["mug"])


class ConceptName(BaseModel):
    """What a concept of a version is called."""

    model: str = Field(description="name of the model")
    version: int = Field(description="its version: another version has other concepts, and names of its own")
    concept: int = Field(description="id of the concept")
    name: str | None = Field(description="what it is called, null for nothing")


class NameChange(BaseModel):
    """A line of the history of a concept's name."""

    name: str | None = Field(description="what it was called from then on, null for nothing")
    at: str = Field(description="UTC, ISO 8601")
    carried_from: str | None = Field(description="NAME:VERSION whose concept had the name; null: a person gave it")


class NameHistory(ConceptName):
    """What a concept is called, and was."""

    history: list[NameChange] = Field(description="oldest first")


class NamedConcept(BaseModel):
    """A concept that has a name."""

    concept: int = Field(description="its id")
    name: str = Field(description="its name")
    carried_from: str | None = Field(description="NAME:VERSION whose concept had the name; null: a person gave it")


class NameList(BaseModel):
    """The names of a version's concepts."""

    model: str = Field(description="name of the model")
    version: int = Field(description="its version")
    names: list[NamedConcept] = Field(description="by id")


class CarriedNames(BaseModel):
    """Names that were carried over."""

    model: str = Field(description="name of the model whose concepts were named")
    version: int = Field(description="its version")
    carried_from: str = Field(description="NAME:VERSION that had the names")
    names: list[CarriedName] = Field(description="that fit, of concepts that nobody has named or unnamed")


class Proposals(BaseModel):
    """Names proposed for concepts."""

    model: str = Field(description="name of the model that answered the clouds")
    version: int = Field(description="its version")
    applied: bool = Field(description="whether the concepts for which one name is proposed are called so from now on")
    proposals: list[Proposal] = Field(description="one for each concept that is the best of a cloud, most clouds first")
    left_out: list[LeftOut] = Field(description="clouds that could not be answered, and had no say")


class LeftOut(BaseModel):
    """A labelled cloud that could not be answered."""

    file: str = Field(description="name of its file as it was sent, empty if it had none")
    label: str = Field(description="its label")
    problem: Problem = Field(description="what was wrong with it")


def router(application: Application) -> APIRouter:
    """The operations, for an application."""
    routes = APIRouter(prefix="/v1/models", tags=["names"], dependencies=[Depends(known_only)])
    settings = application.settings

    @routes.get(
        "/{model}/names",
        summary="Which concepts have names?",
        response_model=NameList,
        responses={**documented(model_examples.NAMES, 404, 422, 500, 503), **caching.DOCUMENTED},
    )
    def names(model: Reference, if_none_match: IfNoneMatch = None) -> Response:
        """The names of the concepts of one version; another version has concepts of its own."""
        name, version = application.which(model)
        held = application.naming.names(name, version)
        named = [
            NamedConcept(concept=id, name=called, carried_from=held.carried.get(id))
            for id, called in sorted(held.of.items())
        ]
        return tagged_by_content(NameList(model=name, version=version, names=named), if_none_match)

    @routes.get(
        "/{model}/concepts/{concept}/name",
        summary="What is a concept called, and was?",
        response_model=NameHistory,
        responses={**documented(model_examples.NAME_HISTORY, 404, 422, 500, 503), **caching.DOCUMENTED},
    )
    def history(model: Reference, concept: ConceptId, if_none_match: IfNoneMatch = None) -> Response:
        """Its name, and the names that it had."""
        name, version = application.which(model)
        changes = [NameChange(**entry._asdict()) for entry in application.naming.history(name, version, concept)]
        called = changes[-1].name if changes else None
        told = NameHistory(model=name, version=version, concept=concept, name=called, history=changes)
        return tagged_by_content(told, if_none_match)

    @routes.put(
        "/{model}/concepts/{concept}/name",
        summary="Give a concept a name",
        responses=documented(model_examples.NAME, 400, 404, 408, 413, 415, 422, 429, 500, 503),
        openapi_extra={
            "requestBody": {
                "required": True,
                "content": {"application/json": {"schema": GivenName.model_json_schema(), "example": {"name": "mug"}}},
            }
        },
    )
    async def rename(request: Request, model: Reference, concept: ConceptId) -> ConceptName:
        """Every replica tells it within seconds. Two concepts may have the same name."""
        with application.intake.opened() as take:
            given = await receive_json(request, limits_of(settings, caller_of(request)), take, GivenName)
        return await run_in_threadpool(_rename, application, model, concept, given.name)

    @routes.delete(
        "/{model}/concepts/{concept}/name",
        summary="Take a concept's name away",
        responses=documented(model_examples.UNNAMED, 404, 422, 500, 503),
    )
    def remove(model: Reference, concept: ConceptId) -> ConceptName:
        """Its history keeps it. A concept without a name stays as it is."""
        return _rename(application, model, concept, None)

    @routes.post(
        "/{model}/names/carry",
        summary="Call concepts what another version calls them",
        responses=documented(model_examples.CARRIED, 404, 422, 429, 500, 503),
    )
    async def carry(model: Reference, source: NamesFrom) -> CarriedNames:
        """Where they still are the same: more than half of the objects of both are common. Training does so by itself.

        A concept that somebody has named, or whose name somebody has taken away, stays as it is. Repeated, it is done
        once. It may take seconds.
        """
        with application.pool.admitted():
            return await application.pool.run(_carry, application, model, source)

    @routes.post(
        "/{model}/names/propose",
        summary="What might concepts be called?",
        responses=documented(model_examples.PROPOSALS, 400, 404, 408, 413, 415, 422, 429, 500, 503),
        openapi_extra={"requestBody": several(settings.max_batch, labelled=True)},
    )
    async def propose(
        request: Request,
        model: Reference,
        apply: Annotated[bool, Query(description="whether names that are proposed are given as well")] = False,
        time: NameTime = None,
        unit: UnitQuery = None,
        viewpoint: ViewpointQuery = None,
    ) -> Proposals:
        """For each concept that is the best one of a labelled cloud, the label that most of these clouds bear.

        Nothing is stored unless `apply=true`; then a proposed name replaces the one that a concept had. Where labels
        tie, none is proposed.
        """
        frame = parse_frame(unit, viewpoint)
        caller = caller_of(request)
        with application.intake.opened() as take:
            limits = limits_of(settings, caller)
            uploads = await receive_clouds(request, limits, take, caller.max_batch, labelled=True)
            labels = [check_concept_name(upload.label) for upload in uploads]
            with application.pool.admitted():
                caller.spend(len(uploads))
                name, version = await application.pool.run(application.prepare, model)
                respond = partial(
                    application.respond, model=name, version=version, time=time, top=1, max_points=caller.max_points
                )
                attempt = partial(answer_each, respond, frame, request.state.id)
                items: list[Item] = await application.pool.run_each(attempt, uploads, request.is_disconnected)
        told = list(zip(labels, items, strict=True))
        answers = [(label, item.answer) for label, item in told if item.answer]
        proposals = await run_in_threadpool(application.naming.propose, name, version, answers, apply=apply)
        return Proposals(
            model=name,
            version=version,
            applied=apply,
            proposals=proposals,
            left_out=[
                LeftOut(file=item.file, label=label, problem=item.problem) for label, item in told if item.problem
            ],
        )

    return routes


def _rename(application: Application, model: str, concept: int, given: str | None) -> ConceptName:
    name, version = application.which(model)
    kept = application.naming.rename(name, version, concept, given)
    return ConceptName(model=name, version=version, concept=concept, name=kept)


def _carry(application: Application, model: str, source: str) -> CarriedNames:
    (name, version), earlier = application.which(model), application.which(source)
    carried = application.naming.carry(earlier, (name, version))
    return CarriedNames(model=name, version=version, carried_from="{}:{}".format(*earlier), names=carried)
