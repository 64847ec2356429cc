"""POST /v1/responses: a cloud in, concepts out."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Depends, Query, Request, Response

from service.answer import Answer
from service.application import Application, CloudFile, parse_viewpoint
from service.clouds import FORMATS, UNITS, parse_camera
from service.engine.model import OnStage
from service.scene_answer import SceneAnswer
from service.transports.arriving import limits_of
from service.transports.connected import while_connected
from service.transports.detail import parse_detail
from service.transports.rest import examples
from service.transports.rest.access import caller_of
from service.transports.rest.bodies import FIELD, MASK, receive_cloud
from service.transports.rest.detail import DetailQuery, as_json
from service.transports.rest.known import remembered
from service.transports.rest.problems import documented
from service.transports.rest.queries import (
    AliasQuery,
    DepthScaleQuery,
    IntrinsicsQuery,
    ModelQuery,
    TimeQuery,
    TopQuery,
    UnitQuery,
    VersionQuery,
    ViewpointQuery,
    known_only,
)
from service.transports.wanted import run_while_wanted

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
BODY: dict[str, Any] = {
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
    "detail=responses,explanation": {"value": examples.ANSWER | {"explanation": examples.EXPLANATION}},
    "detail=concepts": {"value": {k: v for k, v in examples.ANSWER.items() if k not in ("responses", "distances")}},
    "scene=true": {"value": examples.SCENE_ANSWER},
}


def router(application: Application) -> APIRouter:
    """The operation, for an application."""
    routes = APIRouter(prefix="/v1", tags=["responses"], dependencies=[Depends(known_only)])

    @routes.post(
        "/responses",
        summary="Which concepts does a cloud resemble?",
        responses={
            **documented(examples.ANSWER, 400, 404, 408, 413, 415, 422, 429, 500, 503),
            200: {"content": {"application/json": {"examples": _ANSWERS}}},
        },
        response_model=Answer | SceneAnswer,
        openapi_extra={"requestBody": BODY},
    )
    @remembered("answer")
    async def respond(
        request: Request,
        model: ModelQuery = None,
        version: VersionQuery = None,
        alias: AliasQuery = None,
        time: TimeQuery = None,
        top: TopQuery = None,
        unit: UnitQuery = None,
        viewpoint: ViewpointQuery = None,
        intrinsics: IntrinsicsQuery = None,
        depth_scale: DepthScaleQuery = None,
        detail: DetailQuery = None,
        stimuli: Annotated[
            bool, Query(description="whether the answer has the stimuli vector as well, as `detail=stimuli`")
        ] = False,
        explain: Annotated[
            bool, Query(description="whether it says why it is what it is, as `detail=explanation`")
        ] = False,
        segments: Annotated[
            bool,
            Query(description="whether it says of each point sent to which segment it belongs, as `detail=segments`"),
        ] = False,
        scene: Annotated[
            bool,
            Query(
                description="whether the cloud is a whole scene: the largest plane that something stands on and the "
                "objects on it are found, and each object has its own answer, with its place and size"
            ),
        ] = False,
    ) -> Response:
        """Describes the cloud of one object, seen from the origin along +z, and compares it with learned concepts.

        With `scene=true` it does so for each object that stands on a table, a floor or another plane.
        """
        pose = None if viewpoint is None else parse_viewpoint(viewpoint)
        parts = parse_detail(detail, stimuli=stimuli, segments=segments, explain=explain)
        camera = parse_camera(intrinsics, depth_scale)
        caller = caller_of(request)
        application.pool.check()
        with application.intake.opened() as take:
            limits = limits_of(application.settings, caller)
            data, format, name, mask = await receive_cloud(request, limits, take)
            cloud = CloudFile(data, format, name, unit, pose, camera, mask)

            def work(on_stage: OnStage) -> Response:
                answer = (application.respond_scene if scene else application.respond)(
                    cloud,
                    model=model,
                    version=version,
                    alias=alias,
                    time=time,
                    top=top,
                    stimuli=parts.stimuli,
                    explain=parts.explanation,
                    segments=parts.segments,
                    max_points=caller.max_points,
                    on_stage=on_stage,
                )
                left_out = parts.exclude(scene=scene)
                return as_json(answer, left_out)

            with application.pool.admitted():
                return await while_connected(request, run_while_wanted(application.pool, work))

    return routes
