"""/v1/streams: which streams of clouds are answered, and what is answered as it comes."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import AsyncIterator
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Depends, Query, Response
from fastapi.responses import StreamingResponse
from pydantic import BaseModel, Field
from starlette.types import Receive, Scope, Send

from service.application import Application
from service.live import POINTS, Live, Seen, ShownCloud, Watcher
from service.streams import Stream, latency_of
from service.transports.rest import caching
from service.transports.rest.caching import IfNoneMatch, tagged_by_content
from service.transports.rest.problems import documented
from service.transports.rest.queries import known_only

KEEP_ALIVE = 15.0  # seconds of silence after which watchers are told that nothing came
RECONNECT = 1000  # milliseconds after which a watcher that lost the connection asks again
STREAMS: dict[str, Any] = {
    "connected": True,
    "streams": [
        {
            "key": "robots/*/cloud",
            "publish_to": "{key}/concepts",
            "model": "workshop",
            "scene": False,
            "share": "key",
        }
    ],
}


class StreamSummary(BaseModel):
    """A stream of clouds that is answered."""

    key: str = Field(description="zenoh key expression of the clouds")
    publish_to: str = Field(description="key of the answers; {key} is the key that the cloud came on")
    model: str | None = Field(description="that answers; null for the service's own")
    scene: bool = Field(description="whether each object on a plane is answered")
    share: str = Field(description="what replicas share out among themselves: keys, or single clouds")


class StreamList(BaseModel):
    """The streams of the service."""

    connected: bool = Field(description="whether zenoh was reached, so that they are being answered")
    streams: list[StreamSummary] = Field(description="in the order of the settings")


class _Watched(StreamingResponse):
    """Server-sent events, for one client among those who watch for as long as they like."""

    def __init__(self, live: Live, stream: str | None, key: str | None, points: int) -> None:
        self._live, self._stream, self._key, self._points = live, stream, key, points
        headers = {"Cache-Control": "no-cache", "X-Accel-Buffering": "no"}
        super().__init__(iter(()), headers=headers, media_type="text/event-stream")

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        with self._live.watching(self._stream) as watcher:
            self.body_iterator = _told(self._live, watcher, self._key, self._points)
            await super().__call__(scope, receive, send)


def router(application: Application) -> APIRouter:
    """The operations, for an application."""
    routes = APIRouter(prefix="/v1/streams", tags=["streams"], dependencies=[Depends(known_only)])
    live = application.live

    @routes.get(
        "",
        summary="Which streams of clouds are answered?",
        response_model=StreamList,
        responses={**documented(STREAMS, 422, 500, 503), **caching.DOCUMENTED},
    )
    def streams(if_none_match: IfNoneMatch = None) -> Response:
        """Those that the operator has set up; robots publish them over zenoh."""
        found = [_summary(stream) for stream in live.streams]
        return tagged_by_content(StreamList(connected=live.connected, streams=found), if_none_match)

    @routes.get(
        "/events",
        summary="Watch streams",
        response_class=StreamingResponse,
        responses={
            **documented({}, 404, 422, 429, 500, 503),
            200: {
                "description": "Server-sent events",
                "content": {"text/event-stream": {"schema": {"type": "string"}}},
            },
        },
    )
    async def events(
        stream: Annotated[
            str | None,
            Query(max_length=1000, description="key expression of a stream, as it is listed; by default all of them"),
        ] = None,
        key: Annotated[
            str | None,
            Query(max_length=1000, description="only clouds of this key come with points; by default those of all"),
        ] = None,
        points: Annotated[
            int, Query(ge=0, le=POINTS, description="points that a cloud is thinned to for drawing; 0 for none")
        ] = POINTS,
    ) -> Response:
        """Server-sent events until the client leaves: `cloud` is a cloud with its answer, as soon as that is published.

        Its data: `stream`, `key`, `at` (seconds since 1970), `latency_s` (since the robot published it, by its own
        clock; null if unknown), `skipped` (clouds of the key that this client was too slow for: only the newest
        waits), `answer` or `problem` (as published; the other is null), and `cloud`, null where there is none:
        `measured` (points of the cloud), `points` (how many of them follow), `xyz` (base64 of little-endian float32,
        three a point, metres in the sensor's frame: x right, y down, z forward), `parts` (base64 of little-endian
        int16, one a point: its segment, or its object where `kind` is `objects`; -1 for none).

        Whichever replica is asked, it shows what all of them answer.
        """
        return _Watched(live, stream, key, points)

    return routes


def _summary(stream: Stream) -> StreamSummary:
    return StreamSummary(
        key=stream.key, publish_to=stream.publish_to, model=stream.model, scene=stream.scene, share=stream.share
    )


async def _told(live: Live, watcher: Watcher, key: str | None, points: int) -> AsyncIterator[str]:
    """The events of a watcher. A client that is slow to take one keeps nobody else from theirs."""
    yield f"retry: {RECONNECT}\n\n"
    while not live.ended:
        seen = await watcher.take(KEEP_ALIVE)
        if not seen:
            yield ": nothing new\n\n"
        for one in seen:
            yield f"event: cloud\ndata: {_event(one, points if key in (None, one.shown.key) else 0)}\n\n"


def _event(seen: Seen, points: int) -> str:
    """A cloud and its answer, with so many points at most."""
    shown = seen.shown
    source = shown.document.get("source")
    sent_ns = source.get("time_ns") if isinstance(source, dict) else None
    kind = "objects" if "objects" in shown.document else "segments"
    said = {
        "stream": shown.stream,
        "key": shown.key,
        "at": shown.at,
        "latency_s": latency_of(sent_ns, int(shown.at * 1e9)),
        "skipped": seen.skipped,
        "answer": None if shown.problem else shown.document,
        "problem": shown.document if shown.problem else None,
    }
    cloud = "null" if shown.cloud is None or not points else _drawn(shown.cloud, kind, points)
    return f'{json.dumps(said)[:-1]}, "cloud": {cloud}}}'


def _drawn(cloud: ShownCloud, kind: str, most: int) -> str:
    """Some points of a cloud, as they are sent. Base64 needs no escapes: it is not looked through for them."""
    xyz, parts = cloud.points[:most].astype("<f4", copy=False), cloud.parts[:most].astype("<i2", copy=False)
    said = json.dumps({"kind": kind, "measured": cloud.measured, "points": len(xyz)})
    coded = ", ".join(
        f'"{name}": "{b64encode(np.ascontiguousarray(array).data).decode()}"'
        for name, array in (("xyz", xyz), ("parts", parts))
    )
    return f"{said[:-1]}, {coded}}}"
