"""/v1/datasets/NAME/uploads: large files in pieces, in the manner of tus: after an interruption, they go on."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends, Header, Path, Request, Response
from fastapi.concurrency import run_in_threadpool
from pydantic import BaseModel, ConfigDict, Field

from service.application import Application
from service.dataset_cases import Reading
from service.engine.errors import ArchiveTooLarge, UnsupportedFormat, UploadNotFound
from service.transports.arriving import arriving, limits_of, whole
from service.transports.rest import caching, dataset_examples
from service.transports.rest.access import caller_of
from service.transports.rest.batches import parse_frame
from service.transports.rest.caching import IfNoneMatch, tagged_by_content
from service.transports.rest.datasets import UNSAID, Added, DatasetName, largest, tell_each
from service.transports.rest.problems import documented, refused
from service.transports.rest.queries import known_only
from service.transports.rest.uploads import receive_json
from service.uploads import Upload

OFFSET = "Upload-Offset"
PIECE = "application/offset+octet-stream"

UploadId = Annotated[str, Path(pattern="^[0-9a-f]{32}$", description="of the upload", examples=["0" * 32])]


class NewUpload(BaseModel):
    """What an upload is to be."""

    model_config = ConfigDict(extra="forbid")

    length: int = Field(ge=1, description="of the whole file, bytes", examples=[1073741824])
    key: str | None = Field(None, max_length=600, description="of the cloud that it is; null for an archive of clouds")
    replace: bool = Field(False, description="whether a cloud may stand in the place of another one of its key")
    unit: str | None = Field(
        None, max_length=10, description="of the coordinates; by default the files' own, or metres"
    )
    viewpoint: str | None = Field(
        None, max_length=300, description="pose of the sensor: x,y,z or x,y,z,qw,qx,qy,qz; by default the files' own"
    )


def router(application: Application) -> APIRouter:
    """The operations, for an application."""
    routes = APIRouter(prefix="/v1/datasets/{name}/uploads", tags=["datasets"], dependencies=[Depends(known_only)])
    cases, settings = application.datasets, application.settings

    def find(name: str, upload_id: str) -> Upload:
        upload = cases.uploads.show(upload_id)
        if upload.dataset != name:
            raise UploadNotFound(f"The upload {upload_id} is not one to the dataset '{name}'.")
        return upload

    @routes.post(
        "",
        summary="Begin an upload in pieces",
        status_code=201,
        response_model=Upload,
        responses={
            201: documented(dataset_examples.UPLOAD)[200],
            **refused(400, 404, 408, 413, 415, 422, 429, 500, 503),
        },
        openapi_extra={
            "requestBody": {
                "required": True,
                "content": {
                    "application/json": {"schema": NewUpload.model_json_schema(), "example": {"length": 1073741824}}
                },
            }
        },
    )
    async def begin(request: Request, name: DatasetName) -> Response:
        """Of an archive, or of one cloud. Then send the pieces, one after the other, and finish.

        Any replica takes any piece. An upload that nobody goes on with is forgotten after two days.
        """
        with application.intake.opened() as take:
            given = await receive_json(request, limits_of(settings, caller_of(request)), take, NewUpload)
        frame = parse_frame(given.unit, given.viewpoint)
        how = Reading(frame.unit, frame.viewpoint, given.replace)
        most = min(
            largest(settings, caller_of(request)), settings.max_archive if given.key is None else settings.max_body
        )
        if given.length > most:
            raise ArchiveTooLarge(f"The upload is to have {given.length} bytes; at most {most} are taken.")
        upload = await run_in_threadpool(cases.begin, name, given.length, key=given.key, how=how)
        headers = {"Location": f"/v1/datasets/{name}/uploads/{upload.id}", OFFSET: "0"}
        return Response(upload.model_dump_json(), 201, headers, "application/json")

    @routes.get(
        "/{upload}",
        summary="How much of an upload is there?",
        response_model=Upload,
        responses={**documented(dataset_examples.UPLOAD_UNDER_WAY, 404, 422, 500, 503), **caching.DOCUMENTED},
    )
    def show(name: DatasetName, upload: UploadId, if_none_match: IfNoneMatch = None) -> Response:
        """After an interruption: go on with the byte `offset`."""
        found = find(name, upload)
        answer = tagged_by_content(found, if_none_match)
        answer.headers[OFFSET] = str(found.offset)
        return answer

    @routes.patch(
        "/{upload}",
        summary="Send the next piece",
        response_model=Upload,
        responses=documented(dataset_examples.UPLOAD_UNDER_WAY, 400, 404, 408, 409, 413, 415, 422, 429, 500, 503),
        openapi_extra={
            "requestBody": {
                "required": True,
                "content": {
                    kind: {"schema": {"type": "string", "format": "binary"}}
                    for kind in ("application/octet-stream", PIECE)
                },
            }
        },
    )
    async def append(
        request: Request,
        name: DatasetName,
        upload: UploadId,
        upload_offset: Annotated[int, Header(ge=0, le=2**63, description="of the piece in the whole, bytes")],
    ) -> Response:
        """The bytes from `Upload-Offset` on; a piece is kept whole or not at all.

        At least 256 KiB, unless they are the last, and no more than a body may have.
        """
        media_type = request.headers.get("content-type", "").partition(";")[0].strip().lower()
        if media_type not in (PIECE, *UNSAID):
            raise UnsupportedFormat(f"A piece comes as {PIECE}, not as '{media_type[:60]}'.")
        await run_in_threadpool(find, name, upload)
        with application.intake.opened() as take:
            async with arriving(request, limits_of(settings, caller_of(request)), take) as limited:
                data = await whole(limited)
            found = await run_in_threadpool(cases.uploads.append, upload, upload_offset, data)
        return Response(found.model_dump_json(), 200, {OFFSET: str(found.offset)}, "application/json")

    @routes.post(
        "/{upload}/finish",
        summary="Add to the dataset what an upload brought",
        response_model=Added,
        responses=documented(dataset_examples.ADDED, 400, 404, 409, 413, 422, 429, 500, 503),
    )
    async def finish(request: Request, name: DatasetName, upload: UploadId) -> Response:
        """Once all pieces are there. The answer is that of an archive. If it does not arrive, ask again."""
        found, caller = await run_in_threadpool(find, name, upload), caller_of(request)
        with cases.room.opened() as take, cases.spooled() as file:
            take(found.length)
            verdicts = cases.finish(found, file, Reading(max_points=caller.max_points, spend=caller.spend))
            return await tell_each(application, request, name, verdicts)

    @routes.delete(
        "/{upload}", summary="Give an upload up", status_code=204, responses=refused(404, 422, 429, 500, 503)
    )
    def remove(name: DatasetName, upload: UploadId) -> Response:
        """Forgets its pieces."""
        find(name, upload)
        cases.uploads.remove(upload)
        return Response(status_code=204)

    return routes
