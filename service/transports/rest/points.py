"""POST /v1/points: a cloud in any format in, points to draw out."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Depends, Query, Request, Response

from service.application import Application, CloudFile, parse_viewpoint
from service.clouds import FORMATS, parse_camera, write_ply
from service.engine.cloud import PointCloud
from service.engine.model import OnStage
from service.looking import DRAWN, MOST_DRAWN, draw
from service.transports.arriving import limits_of
from service.transports.connected import while_connected
from service.transports.rest.access import caller_of
from service.transports.rest.bodies import receive_cloud
from service.transports.rest.problems import documented
from service.transports.rest.queries import DepthScaleQuery, IntrinsicsQuery, UnitQuery, ViewpointQuery, known_only
from service.transports.rest.responses import BODY
from service.transports.wanted import run_while_wanted

PLY = FORMATS["ply"].media_types[0]
_ANSWER: dict[str, Any] = {"content": {PLY: {"schema": {"type": "string", "format": "binary"}}}}


def router(application: Application) -> APIRouter:
    """The operation, for an application."""
    routes = APIRouter(prefix="/v1", tags=["responses"], dependencies=[Depends(known_only)])

    @routes.post(
        "/points",
        summary="What does a cloud look like?",
        response_class=Response,
        responses={**documented({}, 400, 408, 413, 415, 422, 429, 500, 503), 200: _ANSWER},
        openapi_extra={"requestBody": BODY},
    )
    async def points(
        request: Request,
        most: Annotated[
            int, Query(ge=1, le=MOST_DRAWN, description="points that are sent at most: an even sample of all, points")
        ] = DRAWN,
        unit: UnitQuery = None,
        viewpoint: ViewpointQuery = None,
        intrinsics: IntrinsicsQuery = None,
        depth_scale: DepthScaleQuery = None,
    ) -> Response:
        """The points of a cloud in the sensor's frame, metres, as a binary PLY: to draw whatever file it is.

        Its property `index` is the place of each point among those of the file: `point_segments` and `point_objects`
        of an answer go by it. Each beginning of the points is an even sample as well. Comments in the header have the
        number of points that were `measured` and that the `file` holds, and the `viewpoint`: the sensor's pose in the
        cloud's own frame, metres, x y z qw qx qy qz.
        """
        pose = None if viewpoint is None else parse_viewpoint(viewpoint)
        camera = parse_camera(intrinsics, depth_scale)
        caller = caller_of(request)
        with application.intake.opened() as take:
            data, format, name, mask = await receive_cloud(request, limits_of(application.settings, caller), take)
            cloud = CloudFile(data, format, name, unit, pose, camera, mask)

            def work(_: OnStage) -> Response:
                drawn = draw(application.read(cloud, caller.max_points), most)
                said = {"measured": [drawn.measured], "file": [drawn.in_file], "viewpoint": drawn.viewpoint}
                return Response(write_ply(PointCloud(drawn.points), drawn.places, said), media_type=PLY)

            with application.pool.admitted():
                return await while_connected(request, run_while_wanted(application.pool, work))

    return routes
