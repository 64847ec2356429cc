"""/v1/datasets: clouds to learn from, one by one and as archives, and what people say that they show."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from fastapi import APIRouter, Depends, Path, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import StreamingResponse
from pydantic import BaseModel, ConfigDict, Field

from service.access import Caller
from service.application import Application
from service.archives import MEDIA_TYPES, Kind
from service.clouds import FORMATS, by_media_type
from service.dataset_cases import LabelsTaken, Reading
from service.dataset_records import Dataset, DatasetSummary, Entry, Verdict
from service.engine.errors import Cancelled, UnsupportedFormat
from service.labels import MEDIA_TYPE as TABLE
from service.labels import Label
from service.model_file import NAME
from service.settings import Settings
from service.transports.arriving import arriving, limits_of, whole
from service.transports.rest import caching, dataset_examples
from service.transports.rest.access import caller_of
from service.transports.rest.batches import parse_frame
from service.transports.rest.caching import CHECKED, IfNoneMatch, tag_of, tagged, tagged_by_content
from service.transports.rest.examples import CLOUD_JSON
from service.transports.rest.problems import documented, refused
from service.transports.rest.queries import UnitQuery, ViewpointQuery, known_only
from service.transports.rest.spooling import receive_file
from service.transports.rest.uploads import receive_json

PAGE = 1000  # clouds of a page
ARCHIVES = (*MEDIA_TYPES.values(), "application/x-tar", "application/x-gzip", "application/x-zip-compressed")
KINDS = [entry.media_types[0] for entry in FORMATS.values() if entry.name != "png"]
JSON = "application/json"
UNSAID = ("", "application/octet-stream", "application/x-www-form-urlencoded")

DatasetName = Annotated[str, Path(pattern=f"^{NAME}$", max_length=63, description="of the dataset", examples=["mugs"])]
Key = Annotated[
    str,
    Path(
        min_length=1,
        max_length=600,
        description="of the cloud: a relative path, whose ending may tell the format",
        examples=["kitchen/mug-7.ply"],
    ),
]
Replace = Annotated[bool, Query(description="whether a cloud may stand in the place of another one of its key")]


class NewDataset(BaseModel):
    """What a dataset is to be."""

    model_config = ConfigDict(extra="forbid")

    description: str = Field("", max_length=1000, description="what its clouds are", examples=["mugs of the kitchen"])


class DatasetList(BaseModel):
    """The datasets of the store."""

    datasets: list[DatasetSummary] = Field(description="by name")


class CloudList(BaseModel):
    """Some clouds of a dataset."""

    dataset: str = Field(description="name of the dataset")
    clouds: list[Entry] = Field(description="by key")
    after: str | None = Field(description="what to ask for as `after` to get the next ones; null if there are none")


class Added(BaseModel):
    """What became of several clouds that were sent."""

    dataset: str = Field(description="name of the dataset")
    outcomes: dict[str, int] = Field(description="how many there are of each outcome")
    verdicts: list[Verdict] = Field(description="one for each file, in their order; labels last")


def router(application: Application) -> APIRouter:
    """The operations, for an application."""
    routes = APIRouter(prefix="/v1/datasets", tags=["datasets"], dependencies=[Depends(known_only)])
    cases, settings = application.datasets, application.settings

    @routes.get(
        "",
        summary="Which datasets are there?",
        response_model=DatasetList,
        responses={**documented(dataset_examples.DATASETS, 422, 500, 503), **caching.DOCUMENTED},
    )
    def datasets(if_none_match: IfNoneMatch = None) -> Response:
        """Names and descriptions of all datasets of the store."""
        found = [cases.store.about(name) for name in cases.store.names()]
        return tagged_by_content(DatasetList(datasets=found), if_none_match)

    @routes.get(
        "/{name}",
        summary="What does a dataset hold?",
        response_model=Dataset,
        responses={**documented(dataset_examples.DATASET, 404, 422, 500, 503), **caching.DOCUMENTED},
    )
    def dataset(name: DatasetName, if_none_match: IfNoneMatch = None) -> Response:
        """How many clouds, of which formats and categories, and the digest that a model's manifest names."""
        return tagged_by_content(cases.store.show(name), if_none_match)

    @routes.put(
        "/{name}",
        summary="Make a dataset",
        responses=documented(dataset_examples.SUMMARY, 400, 408, 409, 413, 415, 422, 429, 500, 503),
        openapi_extra={
            "requestBody": {
                "content": {
                    JSON: {
                        "schema": NewDataset.model_json_schema(),
                        "example": {"description": "mugs of the kitchen"},
                    }
                },
            }
        },
    )
    async def create(request: Request, name: DatasetName) -> DatasetSummary:
        """Made again with the same description, or none, it is the same dataset."""
        given = NewDataset()
        if not {"content-type", "transfer-encoding"}.isdisjoint(request.headers):
            with application.intake.opened() as take:
                given = await receive_json(request, limits_of(settings, caller_of(request)), take, NewDataset)
        return await run_in_threadpool(cases.store.create, name, given.description)

    @routes.delete(
        "/{name}", summary="Delete a dataset", status_code=204, responses=refused(404, 409, 422, 429, 500, 503)
    )
    def delete(
        name: DatasetName,
        force: Annotated[bool, Query(description="whether to delete it although models learnt from it")] = False,
    ) -> Response:
        """Refused while the manifest of a model names it, unless forced. Files that another dataset has stay."""
        cases.delete(name, force=force)
        return Response(status_code=204)

    @routes.get(
        "/{name}/clouds",
        summary="Which clouds has a dataset?",
        response_model=CloudList,
        responses={**documented(dataset_examples.CLOUDS, 404, 422, 500, 503), **caching.DOCUMENTED},
    )
    def clouds(
        name: DatasetName,
        after: Annotated[str, Query(max_length=600, description="only clouds whose keys come after this one")] = "",
        limit: Annotated[int, Query(ge=1, le=PAGE, description="how many clouds at most")] = 100,
        if_none_match: IfNoneMatch = None,
    ) -> Response:
        """Key, hash, format and label of each, by key, a page at a time."""
        found = cases.store.page(name, after, limit + 1)
        page = found[:limit]
        following = page[-1].key if len(found) > limit else None
        return tagged_by_content(CloudList(dataset=name, clouds=page, after=following), if_none_match)

    @routes.put(
        "/{name}/clouds/{key:path}",
        summary="Add a cloud to a dataset",
        responses=documented(dataset_examples.VERDICT, 400, 404, 408, 409, 413, 415, 422, 429, 500, 503),
        openapi_extra={"requestBody": _cloud_body()},
    )
    async def put(
        request: Request,
        name: DatasetName,
        key: Key,
        unit: UnitQuery = None,
        viewpoint: ViewpointQuery = None,
        replace: Replace = False,
        category: Annotated[str | None, Query(min_length=1, max_length=200, description="what the cloud shows")] = None,
        group: Annotated[
            str, Query(max_length=500, description="clouds of one group never stand in both halves of a split")
        ] = "",
    ) -> Verdict:
        """The file of one object's cloud, in any of the formats but a depth image; it is kept byte for byte.

        Sent again, nothing happens; another cloud of the same key is refused unless `replace=true`. What cannot be
        read or learnt from is refused.
        """
        caller, frame = caller_of(request), parse_frame(unit, viewpoint)
        how = Reading(frame.unit, frame.viewpoint, replace, caller.max_points)
        format = by_media_type(request.headers.get("content-type", ""))
        label = None if category is None else Label(category=category, group=group)
        with application.intake.opened() as take:
            async with arriving(request, limits_of(settings, caller), take) as limited:
                data = await whole(limited)
            with application.pool.admitted():
                return await application.pool.run(cases.put, name, key, data, how, format=format, label=label)

    @routes.get(
        "/{name}/clouds/{key:path}",
        summary="Download a cloud",
        response_class=Response,
        responses={
            **refused(404, 422, 500, 503),
            **caching.DOCUMENTED,
            200: {"content": {kind: {"example": CLOUD_JSON} if kind == JSON else {} for kind in KINDS}},
        },
    )
    def cloud(name: DatasetName, key: Key, if_none_match: IfNoneMatch = None) -> Response:
        """Byte for byte as it was sent."""
        entry = cases.store.entry(name, key)
        media_type = FORMATS[entry.format].media_types[0]
        found = tagged(f'"{entry.sha256}"', if_none_match, CHECKED, lambda: cases.store.content(entry), media_type)
        found.headers["X-Content-Type-Options"] = "nosniff"
        return found

    @routes.post(
        "/{name}/archive",
        summary="Add the clouds of an archive to a dataset",
        response_model=Added,
        responses=documented(dataset_examples.ADDED, 400, 404, 408, 413, 415, 422, 429, 500, 503),
        openapi_extra={"requestBody": _archive_body()},
    )
    async def unpack(
        request: Request,
        name: DatasetName,
        unit: UnitQuery = None,
        viewpoint: ViewpointQuery = None,
        replace: Replace = False,
    ) -> Response:
        """A zip or tar, packed with gzip or not: a verdict for each of its files, whose paths become keys.

        A `labels.csv` in it labels the clouds beside it. Sent again after it was interrupted, only what is missing is
        stored. An archive with links, with names that lead out of it, that is cut off or unfolds out of proportion is
        refused as a whole.
        """
        _check_archive(request.headers.get("content-type", ""))
        caller, frame = caller_of(request), parse_frame(unit, viewpoint)
        how = Reading(frame.unit, frame.viewpoint, replace, caller.max_points, caller.spend)
        await run_in_threadpool(cases.store.about, name)
        limits = limits_of(settings, caller)
        limits = limits._replace(max_bytes=largest(settings, caller), timeout=settings.archive_timeout)
        with cases.room.opened() as take, cases.spooled() as file:
            async with arriving(request, limits, take) as limited:
                await receive_file(limited, file)
            return await tell_each(application, request, name, cases.unpack(name, file, how))

    @routes.get(
        "/{name}/archive",
        summary="Download a dataset",
        response_class=Response,
        responses={
            **refused(404, 422, 500, 503),
            **caching.DOCUMENTED,
            200: {"content": {media_type: {} for media_type in MEDIA_TYPES.values()}},
        },
    )
    def pack(
        name: DatasetName,
        format: Annotated[Kind, Query(description="of the archive")] = "tar.gz",
        if_none_match: IfNoneMatch = None,
    ) -> Response:
        """All clouds by their keys, `labels.csv` if there are labels, and `dataset.json`, which says how they are read.

        Added to another dataset, it makes the same one.
        """
        snapshot = cases.snapshot(name)
        tag = tag_of(format, snapshot.model_dump_json())
        headers = {"ETag": tag, "Cache-Control": CHECKED}
        if caching.is_held(tag, if_none_match):
            return Response(status_code=304, headers=headers)
        headers["Content-Disposition"] = f'attachment; filename="{name}.{format}"'
        headers["Content-Encoding"] = "identity"  # it is packed already
        return StreamingResponse(cases.pack(snapshot, format), headers=headers, media_type=MEDIA_TYPES[format])

    @routes.put(
        "/{name}/labels",
        summary="Say what clouds show",
        responses=documented(dataset_examples.LABELS_TAKEN, 400, 404, 408, 413, 415, 422, 429, 500, 503),
        openapi_extra={
            "requestBody": {
                "required": True,
                "content": {TABLE: {"schema": {"type": "string"}, "example": dataset_examples.LABELS}},
            }
        },
    )
    async def label(request: Request, name: DatasetName) -> LabelsTaken:
        """A table with the columns `file`, which is the key of a cloud, and `category`.

        `fine`, `instance`, `view`, `source` and `group` may be added. Labels of clouds that it does not name stay.
        """
        media_type = _bare(request.headers.get("content-type", ""))
        if media_type not in (TABLE, "text/plain", *UNSAID):
            raise UnsupportedFormat(f"Labels come as {TABLE}, not as '{media_type[:60]}'.")
        with application.intake.opened() as take:
            async with arriving(request, limits_of(settings, caller_of(request)), take) as limited:
                table = await whole(limited)
            with application.pool.admitted():
                return await application.pool.run(cases.take_labels, name, table)

    @routes.get(
        "/{name}/labels",
        summary="Download what is said of clouds",
        response_class=Response,
        responses={
            **refused(404, 422, 500, 503),
            **caching.DOCUMENTED,
            200: {"content": {TABLE: {"example": dataset_examples.LABELS}}},
        },
    )
    def labels(name: DatasetName, if_none_match: IfNoneMatch = None) -> Response:
        """The labels of all clouds that have one, with all columns."""
        table = cases.table(name)
        return tagged(tag_of(table), if_none_match, CHECKED, lambda: table, TABLE)

    return routes


def largest(settings: Settings, caller: Caller) -> int:
    """Bytes of the largest archive of a caller: a key that may send less than others in a body may do so here, too."""
    return settings.max_archive if caller.max_body >= settings.max_body else caller.max_body


async def tell_each(application: Application, request: Request, name: str, verdicts: Iterator[Verdict]) -> Response:
    """The verdicts on several clouds, which are taken one after the other, in one place among those that wait.

    Raises:
        Cancelled: the client hung up; what was taken stays.
    """
    told: list[Verdict] = []
    with application.pool.admitted():
        while (verdict := await application.pool.run(next, verdicts, None)) is not None:
            told.append(verdict)
            if await request.is_disconnected():
                raise Cancelled(f"The client hung up after {len(told)} verdicts; send it again to have the others.")
        return await application.pool.run(_as_json, name, told)


def _as_json(name: str, verdicts: list[Verdict]) -> Response:
    outcomes: dict[str, int] = {}
    for verdict in verdicts:
        outcomes[verdict.outcome] = outcomes.get(verdict.outcome, 0) + 1
    document = Added(dataset=name, outcomes=outcomes, verdicts=verdicts)
    return Response(document.model_dump_json(), media_type=JSON)


def _bare(media_type: str) -> str:
    return media_type.partition(";")[0].strip().lower()


def _check_archive(media_type: str) -> None:
    if _bare(media_type) not in (*ARCHIVES, *UNSAID):
        raise UnsupportedFormat(
            f"An archive comes as {', '.join(ARCHIVES[:3])}, not as '{_bare(media_type)[:60]}'. A single cloud is put "
            "under its key."
        )


def _cloud_body() -> dict[str, object]:
    files = {"schema": {"type": "string", "format": "binary"}}
    kinds = ["application/octet-stream", *(f.media_types[0] for f in FORMATS.values() if f.name != "png")]
    return {"required": True, "content": dict.fromkeys(kinds, files)}


def _archive_body() -> dict[str, object]:
    files = {"schema": {"type": "string", "format": "binary"}}
    return {"required": True, "content": dict.fromkeys(("application/octet-stream", *ARCHIVES[:3]), files)}
