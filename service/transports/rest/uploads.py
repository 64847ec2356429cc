"""Bodies that hold more, or less, than one cloud: several clouds with what belongs to each, or a small JSON object."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

from fastapi import Request
from fastapi.concurrency import run_in_threadpool
from pydantic import BaseModel, ValidationError
from starlette.datastructures import UploadFile
from starlette.exceptions import HTTPException

from service.clouds.json_list import split
from service.engine.errors import ContentTooLarge, InvalidParameter, UnreadableCloud, UnsupportedFormat
from service.transports.arriving import Limits, arriving, whole
from service.transports.rest.bodies import FIELD

LABEL = "label"
SMALL = 2**14  # bytes of the largest JSON object

Body = TypeVar("Body", bound=BaseModel)


class Upload(NamedTuple):
    """One of several clouds, as it was sent.

    Attributes:
        data: its bytes.
        media_type: what the client says they are, "" for nothing.
        name: of the file, "" for none.
        label: what the client calls the object, "" for nothing.
    """

    data: bytes
    media_type: str
    name: str
    label: str = ""


def several(most: int, *, labelled: bool = False) -> dict[str, Any]:
    """OpenAPI's description of a body with several clouds.

    Args:
        most: of them.
        labelled: whether each has a label, so that they come as a form; otherwise they may be a JSON list as well.
    """
    files = {"type": "array", "minItems": 1, "maxItems": most, "items": {"type": "string", "format": "binary"}}
    properties: dict[str, Any] = {FIELD: files}
    if labelled:
        words = {"type": "string", "minLength": 1, "maxLength": 100}
        properties[LABEL] = {"type": "array", "minItems": 1, "maxItems": most, "items": words}
    form = {"schema": {"type": "object", "required": list(properties), "properties": properties}}
    clouds = {"type": "array", "minItems": 1, "maxItems": most, "items": {}}
    content = {"multipart/form-data": form} | ({} if labelled else {"application/json": {"schema": clouds}})
    how = f"The files of at most {most} clouds, each in a field `{FIELD}` of a form"
    how += f", and the label of each in a field `{LABEL}`, in the same order" if labelled else ""
    how += "." if labelled else "; or a JSON list of clouds, each as `POST /v1/responses` takes it in JSON."
    return {"required": True, "description": how, "content": content}


async def receive_clouds(
    request: Request, limits: Limits, take: Callable[[int], None], most: int, *, labelled: bool = False
) -> list[Upload]:
    """Receives several clouds: the files of a form, or a JSON list.

    Args:
        request: with the clouds.
        limits: on the whole body.
        take: called with the number of bytes as they arrive; may raise `Overloaded`.
        most: number of clouds.
        labelled: whether each has a label; then they come as a form.

    Raises:
        UnreadableCloud: the form or the list is malformed, or holds no cloud, or labels for more or fewer of them.
        UnsupportedFormat: it is neither.
        ContentTooLarge: there are too many.
        HTTPException: as `arriving` raises.
    """
    media_type = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    async with arriving(request, limits, take) as limited:
        if media_type == "multipart/form-data":
            uploads = await _of_form(limited, most, labelled)
        elif media_type == "application/json" and not labelled:
            listed = await run_in_threadpool(split, await whole(limited), most + 1)
            uploads = [Upload(cloud, "application/json", "") for cloud in listed]
        else:
            known = "multipart/form-data" if labelled else "multipart/form-data or application/json"
            raise UnsupportedFormat(f"Several clouds come as {known}, not as '{media_type[:60]}'.")
    if len(uploads) > most:
        raise _too_many(most)
    return uploads


async def _of_form(request: Request, most: int, labelled: bool) -> list[Upload]:
    try:
        async with request.form(max_files=most, max_fields=most, max_part_size=SMALL) as form:
            parts = [part for part in form.getlist(FIELD) if isinstance(part, UploadFile)]
            labels = (
                [label for label in form.getlist(LABEL) if isinstance(label, str)] if labelled else [""] * len(parts)
            )
            if not parts:
                raise UnreadableCloud(f"The form has no file in the field '{FIELD}': send each with -F {FIELD}=@FILE.")
            if len(labels) != len(parts):
                raise UnreadableCloud(
                    f"The form has {len(parts)} files in the field '{FIELD}' and {len(labels)} labels in the field "
                    f"'{LABEL}'; each file needs one: -F {FIELD}=@FILE -F {LABEL}=WORD."
                )
            return [
                Upload(await part.read(), part.content_type or "", part.filename or "", label)
                for part, label in zip(parts, labels, strict=True)
            ]
    except HTTPException as error:
        if error.status_code != 400:
            raise
        if error.detail.startswith("Too many"):
            raise _too_many(most) from None
        raise UnreadableCloud(f"The form cannot be read: {error.detail}") from error


def _too_many(most: int) -> ContentTooLarge:
    return ContentTooLarge(f"There are more than {most} clouds; send them in several requests.")


async def receive_json(request: Request, limits: Limits, take: Callable[[int], None], kind: type[Body]) -> Body:
    """Receives a small JSON object.

    Raises:
        UnsupportedFormat: the body is said to be something else.
        InvalidParameter: the object has other members, or values, than it should.
        HTTPException: 400, it is no JSON; or as `arriving` raises.
    """
    media_type = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if media_type != "application/json":
        raise UnsupportedFormat(f"The body should be application/json, not '{media_type[:60]}'.")
    async with arriving(request, limits._replace(max_bytes=min(SMALL, limits.max_bytes)), take) as limited:
        body = await whole(limited)
    try:
        return kind.model_validate_json(body)
    except ValidationError as error:
        faults = error.errors(include_url=False, include_input=False)
        if faults[0]["type"] == "json_invalid":
            raise HTTPException(400, f"The body is no JSON object: {faults[0]['msg']}.") from None
        said = [f"{'.'.join(map(str, fault['loc'])) or 'body'}: {fault['msg']}"[:200] for fault in faults[:5]]
        raise InvalidParameter("; ".join(said) + ".") from None
