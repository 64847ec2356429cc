"""The cloud in the body of a request: as the body itself, or as a part of a form."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from fastapi import Request
from starlette.datastructures import UploadFile
from starlette.exceptions import HTTPException

from service.clouds import by_media_type
from service.clouds.claims import quote
from service.engine.errors import UnreadableCloud
from service.transports.arriving import Limits, arriving, whole

FIELD = "cloud"
MASK = "mask"


class Received(NamedTuple):
    """What a request brought.

    Attributes:
        data: the bytes of the cloud's file.
        format: of the cloud; None where the content has to tell.
        name: of the file, "" for none.
        mask: the file of a depth image's mask, if there was one.
    """

    data: bytes
    format: str | None = None
    name: str = ""
    mask: bytes | None = None


async def receive_cloud(request: Request, limits: Limits, take: Callable[[int], None]) -> Received:
    """Receives the file of a request.

    Args:
        request: with the file as its body, or with a form that has it in the field `cloud`, and may have another in
            the field `mask`.
        limits: on the body.
        take: called with the number of bytes as they arrive; may raise `Overloaded`.

    Raises:
        UnsupportedFormat: the media type is not that of a cloud.
        UnreadableCloud: the form is malformed, has no such field, or other files.
        Cancelled: the client hung up.
        ContentTooLarge: the body is larger than the limit.
        HTTPException: 408, it did not arrive in time.
    """
    media_type = request.headers.get("content-type", "")
    form = media_type.partition(";")[0].strip().lower() == "multipart/form-data"
    format = None if form else by_media_type(media_type)
    async with arriving(request, limits, take) as limited:
        if form:
            return await _from_form(limited)
        return Received(await whole(limited), format)


async def _from_form(request: Request) -> Received:
    try:
        async with request.form(max_files=2, max_fields=8) as form:
            parts = [(name, part) for name, part in form.multi_items() if isinstance(part, UploadFile) or name == MASK]
            files = {name: part for name, part in parts if isinstance(part, UploadFile)}
            if FIELD not in files:
                raise UnreadableCloud(f"The form has no file in the field '{FIELD}': send it with -F {FIELD}=@FILE.")
            if len(files) < len(parts) or not files.keys() <= {FIELD, MASK}:
                raise UnreadableCloud(
                    f"The form has the fields {quote([name for name, _ in parts])}: it should have one file in "
                    f"'{FIELD}' and, for a depth image, may have one in '{MASK}'."
                )
            cloud = files[FIELD]
            mask = await files[MASK].read() if MASK in files else None
            return Received(await cloud.read(), by_media_type(cloud.content_type or ""), cloud.filename or "", mask)
    except HTTPException as error:
        if error.status_code != 400:
            raise
        raise UnreadableCloud(f"The form cannot be read: {error.detail}") from error
