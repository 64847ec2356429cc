"""POST /v1/responses: a cloud in, concepts out."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Depends, Query, Request

from service.answer import Answer
from service.application import Application, CloudFile, parse_viewpoint
from service.clouds import FORMATS, UNITS, parse_camera
from service.transports.arriving import limits_of
from service.transports.rest import examples
from service.transports.rest.bodies import FIELD, MASK, receive_cloud
from service.transports.rest.problems import documented
from service.transports.rest.queries import known_only

_BINARY: dict[str, Any] = {"schema": {"type": "string", "format": "binary"}}
_TEXT: dict[str, Any] = {"schema": {"type": "string"}, "example": examples.CLOUD_XYZ}
_NUMBERS: dict[str, Any] = {"type": "array", "items": {"type": ["number", "null"]}}
_POINTS: dict[str, Any] = {
    "type": "array",
    "items": {"oneOf": [_NUMBERS | {"minItems": 3, "maxItems": 3}, {"type": "null"}]},
    "description": "x, y, z of each; null where nothing was measured",
}
_JSON: dict[str, Any] = {
    "schema": {
        "oneOf": [
            _POINTS,
            {
                "type": "object",
                "required": ["points"],
                "additionalProperties": False,
                "properties": {
                    "points": _POINTS,
                    "unit": {"enum": [*UNITS, None], "description": "of the coordinates; metres by default"},
                    "viewpoint": {
                        "type": ["array", "null"],
                        "items": {"type": "number"},
                        "minItems": 3,
                        "maxItems": 7,
                        "description": "pose of the sensor: x, y, z or x, y, z, qw, qx, qy, qz",
                    },
                },
            },
        ]
    },
    "example": examples.CLOUD_JSON,
}
_CONTENTS = {"xyz": _TEXT, "json": _JSON}  # the others are binary
_FILE = {"type": "string", "format": "binary"}
_FORM: dict[str, Any] = {
    "schema": {
        "type": "object",
        "required": [FIELD],
        "properties": {
            FIELD: _FILE | {"description": "the file of the cloud"},
            MASK: _FILE | {"description": "for a depth image: PNG or NPY of its size, not 0 where the object is"},
        },
    }
}
_BODY = {
    "required": True,
    "description": "The file of a cloud, as the body itself or in the field `cloud` of a form: "
    + "; ".join(f"{entry.title} (`{entry.media_types[0]}`)" for entry in FORMATS.values())
    + ". Sent as `application/octet-stream`, its content tells. A depth image comes with its `intrinsics`.",
    "content": {
        "application/octet-stream": _BINARY,
        **{entry.media_types[0]: _CONTENTS.get(entry.name, _BINARY) for entry in FORMATS.values()},
        "multipart/form-data": _FORM,
    },
}


_ANSWERS = {
    "plain": {"value": examples.ANSWER},
    "explain=true": {"value": examples.ANSWER | {"explanation": examples.EXPLANATION}},
}


def router(application: Application) -> APIRouter:
    """The operation, for an application."""
    routes = APIRouter(prefix="/v1", tags=["responses"], dependencies=[Depends(known_only)])
    limits = limits_of(application.settings)

    @routes.post(
        "/responses",
        summary="Which concepts does a cloud resemble?",
        responses={
            **documented(examples.ANSWER, 400, 404, 408, 413, 415, 422, 429, 500, 503),
            200: {"content": {"application/json": {"examples": _ANSWERS}}},
        },
        openapi_extra={"requestBody": _BODY},
    )
    async def respond(
        request: Request,
        model: Annotated[
            str | None,
            Query(
                max_length=200, description="NAME, NAME@ALIAS or NAME:VERSION; by default the only model of the store"
            ),
        ] = None,
        version: Annotated[int | None, Query(ge=1, le=99_999_999, description="version of the model")] = None,
        alias: Annotated[str | None, Query(max_length=63, description="alias of the model's version")] = None,
        time: Annotated[
            float | None,
            Query(
                ge=0,
                le=1,
                description="filtration time of all concepts: 0 specific, 1 generic; by default those at the model's "
                "epsilon_max come first and the specific and generic ones of other times follow",
            ),
        ] = None,
        top: Annotated[int | None, Query(ge=1, description="how many concepts are listed; by default all")] = None,
        unit: Annotated[
            str | None,
            Query(description=f"of the coordinates: {', '.join(UNITS)}; by default the file's own, or metres"),
        ] = None,
        viewpoint: Annotated[
            str | None,
            Query(
                max_length=300,
                description="pose of the sensor in the cloud's frame and unit: x,y,z or x,y,z,qw,qx,qy,qz",
                examples=["0.0,-0.4,-0.9"],
            ),
        ] = None,
        intrinsics: Annotated[
            str | None,
            Query(
                max_length=200,
                description="of the camera of a depth image: fx,fy,cx,cy, pixels; its pixels are numbered row by row",
                examples=["525,525,319.5,239.5"],
            ),
        ] = None,
        depth_scale: Annotated[
            float | None,
            Query(
                gt=0,
                description="metres that a depth of 1 stands for; by default 0.001 for whole numbers and 1 for floats",
            ),
        ] = None,
        stimuli: Annotated[bool, Query(description="whether the answer has the stimuli vector as well")] = False,
        explain: Annotated[bool, Query(description="whether the answer says why it is what it is")] = False,
        segments: Annotated[
            bool, Query(description="whether the answer says of each point sent to which segment it belongs")
        ] = False,
    ) -> Answer:
        """Describes the cloud of one object, seen from the origin along +z, and compares it with learned concepts."""
        pose = parse_viewpoint(viewpoint) if viewpoint else None
        camera = parse_camera(intrinsics, depth_scale)
        with application.intake.opened() as take:
            data, format, name, mask = await receive_cloud(request, limits, take)
            with application.pool.admitted():
                return await application.pool.run(
                    application.respond,
                    CloudFile(data, format, name, unit, pose, camera, mask),
                    model=model,
                    version=version,
                    alias=alias,
                    time=time,
                    top=top,
                    stimuli=stimuli,
                    explain=explain,
                    segments=segments,
                )

    return routes
