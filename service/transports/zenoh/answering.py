"""Streams of clouds: each is answered on a key beside its own, the newest first, by one of the replicas."""

from __future__ import annotations

import asyncio
import hashlib
import json
import logging
import time as clock
import uuid
from concurrent.futures import Future
from contextlib import ExitStack
from typing import Any, NamedTuple

import numpy as np
import zenoh
from zenoh.handlers import Callback

from service.application import Application, CloudFile, parse_viewpoint
from service.clouds import DepthCamera, Viewpoint, parse_camera
from service.clouds.formats import by_content
from service.engine.errors import InvalidParameter, Overloaded
from service.live import POINTS, ShownCloud, shown
from service.looking import Drawing
from service.scene_answer import SceneAnswer
from service.streams import Stream
from service.transports.errors import MEDIA_TYPE
from service.transports.zenoh.attachments import mask_of
from service.transports.zenoh.encodings import POINT_CLOUD2, format_of, format_of_key
from service.transports.zenoh.newest import Newest, Taken
from service.transports.zenoh.problems import check_size, problem_of
from service.transports.zenoh.queries import JSON
from service.transports.zenoh.replicas import Replicas
from service.transports.zenoh.showing import Showing
from service.transports.zenoh.source import Source, attachment_of, ros_header, source_of

log = logging.getLogger(__name__)

KEYS = 1000  # robots, or other publishers, that one stream can tell apart
PAUSE = 0.05  # seconds between attempts to get a place in the pool
SETTLING = 0.5  # seconds in which the other replicas learn that there is one more
LOGGED = 10.0  # seconds between two lines of the log about drops
BODY = Viewpoint(orientation=(0.5, -0.5, 0.5, -0.5))  # of a sensor whose cloud has x forward, y left, z up


class Told(NamedTuple):
    """What is said about a cloud.

    Attributes:
        document: the answer, or a problem document.
        encoding: which of the two.
        source: where the cloud comes from, with what it says of that itself.
        parts: the segment, or object of a scene, of each point that is drawn; None where nobody wants to know.
    """

    document: dict[str, Any]
    encoding: str
    source: Source
    parts: list[int] | None = None


class Sent(NamedTuple):
    """A cloud as it came.

    Attributes:
        source: where it comes from.
        payload: its bytes; an error where they are refused already.
        encoding: that of zenoh.
        attachment: to carry over.
        mask: the file of a depth image's mask, if it came with one.
        held: of the limits on what is in memory.
    """

    source: Source
    payload: zenoh.ZBytes | Exception
    encoding: zenoh.Encoding
    attachment: bytes | None
    mask: bytes | None
    held: ExitStack


class Answering:
    """Answers the clouds of one stream.

    zenoh calls on its own threads: there a cloud is only put in its place. Per key, the newest cloud waits while
    another is at work, and one that it supersedes is dropped and counted.

    Args:
        application: that answers.
        session: of zenoh, open.
        stream: what is answered, and how.
        turns: how many clouds of all streams are worked on at the same time.

    Raises:
        InvalidParameter: the stream cannot be.
    """

    def __init__(
        self, application: Application, session: zenoh.Session, stream: Stream, turns: asyncio.Semaphore
    ) -> None:
        self._application = application
        self._session = session
        self._stream = stream
        self._turns = turns
        self._pose = pose_of(stream)
        self._camera = camera_of(stream)
        self._key = key_of(stream)
        at_once = 1 if stream.share == "key" else application.settings.workers
        self._newest: Newest[Sent] = Newest(KEYS, at_once, lambda sent: sent.held.close())
        self._workers: set[Future[None]] = set()
        self._dropped: dict[str, int] = {}  # not yet told in the log
        self._logged = clock.monotonic()

    async def open(self, others: list[Stream]) -> None:
        """Begins to answer.

        Args:
            others: all streams of the service; their answers are no clouds.
        """
        self._loop = asyncio.get_running_loop()
        self._streams = others
        self._replicas = await asyncio.to_thread(Replicas, self._session, self._stream)
        self._showing = await asyncio.to_thread(
            Showing, self._application.live, self._session, self._stream, self._loop
        )
        await asyncio.sleep(SETTLING)  # the others leave us our share before we begin: better missed than twice
        self._subscriber = await asyncio.to_thread(
            self._session.declare_subscriber, self._key, Callback(self._arrived, indirect=False)
        )
        log.info("answering the stream %s on %s", self._stream.key, self._stream.publish_to)

    async def close(self) -> None:
        """Takes no more clouds, and answers those at work."""
        await asyncio.to_thread(self._subscriber.undeclare)
        self._newest.clear()
        await asyncio.gather(*map(asyncio.wrap_future, list(self._workers)), return_exceptions=True)
        await asyncio.to_thread(self._showing.close)
        await asyncio.to_thread(self._replicas.close)

    def _arrived(self, sample: zenoh.Sample) -> None:
        """Puts a cloud in its place, if this replica is to answer it."""
        try:
            key = str(sample.key_expr)
            if sample.kind != zenoh.SampleKind.PUT or any(stream.is_answer(key) for stream in self._streams):
                return
            attachment = attachment_of(sample)
            source = source_of(sample, attachment)
            if not self._replicas.mine(self._item(sample, source)):
                return
            held = ExitStack()
            payload: zenoh.ZBytes | Exception = sample.payload
            mask: bytes | None = None
            try:
                size = len(sample.payload) + (0 if sample.attachment is None else len(sample.attachment))
                check_size(size, self._application.settings.max_body)
                held.enter_context(self._application.intake.opened())(size)
                mask = mask_of(sample)
            except Overloaded:
                held.close()
                self._newest.drop(key)
                return
            except Exception as error:
                payload = error
            if self._newest.put(key, Sent(source, payload, sample.encoding, attachment, mask, held)):
                worker = asyncio.run_coroutine_threadsafe(self._work(key), self._loop)
                self._workers.add(worker)
                worker.add_done_callback(self._workers.discard)
        except Exception:
            log.exception("a cloud of the stream %s could not be taken", self._stream.key)

    def _item(self, sample: zenoh.Sample, source: Source) -> bytes:
        """What the replicas share out: the key, or the single cloud, named by what all of them see alike."""
        if self._stream.share == "key":
            return source.key.encode()
        if source.sequence is not None or source.time_ns is not None:
            return f"{source.key} {source.sequence} {source.time_ns}".encode()
        return source.key.encode() + hashlib.blake2b(sample.payload.to_bytes()).digest()

    async def _work(self, key: str) -> None:
        """Answers the clouds of a key until there are no more."""
        while True:
            async with self._turns:
                with await self._place():
                    taken = self._newest.take(key)
                    if taken is None:
                        return
                    with taken.item.held:
                        try:
                            await self._answer(taken)
                        except Exception:  # the next cloud of the key may fare better
                            log.exception("a cloud of %s could not be answered", key)

    async def _place(self) -> ExitStack:
        """A place in the pool, waited for: meanwhile, newer clouds take the place of older ones."""
        place = ExitStack()
        while True:
            try:
                place.enter_context(self._application.pool.admitted())
                return place
            except Overloaded:
                await asyncio.sleep(PAUSE)

    async def _answer(self, taken: Taken[Sent]) -> None:
        source, drawing = taken.item.source, Drawing(POINTS) if self._showing.wanted else None
        with self._application.telemetry.request("zenoh", str(uuid.uuid4()), "stream") as seen:
            try:
                told = await self._application.pool.run(self._respond, taken.item, drawing)
            except Exception as error:
                seen.failed(error)
                told = Told(problem_of(error, source.key, seen.request_id), MEDIA_TYPE, source)
        document = told.document | {"source": told.source.told(), "dropped": taken.dropped}
        self._tell_drops(source.key, taken.dropped)
        try:
            await asyncio.to_thread(
                self._session.put,
                self._stream.answers_on(source.key),
                json.dumps(document),
                encoding=told.encoding,
                attachment=taken.item.attachment,
            )
        except zenoh.ZError as error:
            log.warning("an answer to %s could not be published: %s", source.key, error)
        if drawing is not None:
            cloud = drawn_cloud(drawing, told.parts)
            problem = told.encoding == MEDIA_TYPE
            now = shown(self._stream, source.key, document, problem=problem, cloud=cloud)
            await asyncio.to_thread(self._showing.show, now)

    def _respond(self, sent: Sent, drawing: Drawing | None) -> Told:
        """The answer to a cloud."""
        if isinstance(sent.payload, Exception):
            raise sent.payload
        stream, source = self._stream, sent.source
        data = sent.payload.to_bytes()
        format = stream.format or format_of_key(source.key) or format_of(sent.encoding) or by_content(data)
        if format == POINT_CLOUD2 and (header := ros_header(data)):
            source = source._replace(frame_id=header.frame_id, stamp_ns=header.stamp_ns)
        cloud = CloudFile(data, format, unit=stream.unit, viewpoint=self._pose, camera=self._camera, mask=sent.mask)
        respond = self._application.respond_scene if stream.scene else self._application.respond
        answer = respond(cloud, model=stream.model, time=stream.time, top=stream.top, drawing=drawing)
        parts = answer.point_objects if isinstance(answer, SceneAnswer) else answer.point_segments
        document = answer.model_dump(mode="json", exclude={"point_segments", "point_objects"})
        return Told(document, JSON, source, parts)

    def _tell_drops(self, key: str, dropped: int) -> None:
        """Logs drops, not more often than every few seconds."""
        if dropped:
            self._application.telemetry.dropped("zenoh", dropped)
            self._dropped[key] = self._dropped.get(key, 0) + dropped
        if self._dropped and clock.monotonic() - self._logged > LOGGED:
            told = ", ".join(f"{count} of {name}" for name, count in list(self._dropped.items())[:20])
            log.warning("clouds dropped for newer ones: %s", told)
            self._dropped, self._logged = {}, clock.monotonic()


def drawn_cloud(drawing: Drawing, parts: list[int] | None) -> ShownCloud | None:
    """What is shown of a cloud; None if it could not be read.

    Args:
        drawing: what is drawn of it.
        parts: the segment or object of each drawn point, -1 for none; None if that is not known.
    """
    if (drawn := drawing.drawn) is None:
        return None
    numbers = np.full(len(drawn.points), -1) if parts is None else np.asarray(parts)
    return ShownCloud(drawn.points, np.clip(numbers, -1, 2**15 - 1).astype(np.int16), drawn.measured)


def pose_of(stream: Stream) -> Viewpoint | None:
    """The sensor's pose in the frame of a stream's clouds.

    Raises:
        InvalidParameter: the viewpoint is none, or contradicts the frame.
    """
    if stream.viewpoint is None:
        return BODY if stream.frame == "body" else None
    if stream.frame != "optical":
        raise InvalidParameter(f"The stream {stream.key} has a viewpoint and a frame; a viewpoint says it all.")
    return parse_viewpoint(stream.viewpoint)


def camera_of(stream: Stream) -> DepthCamera | None:
    """The camera that takes a stream's depth images; None where they are clouds.

    Raises:
        InvalidParameter: it is none.
    """
    return parse_camera(stream.intrinsics, stream.depth_scale)


def key_of(stream: Stream) -> zenoh.KeyExpr:
    """The key expression of a stream.

    Raises:
        InvalidParameter: it is none, or that of its answers would be none.
    """
    try:
        zenoh.KeyExpr(stream.answers_on("robot/cloud"))
        return zenoh.KeyExpr(stream.key)
    except zenoh.ZError as error:
        raise InvalidParameter(
            f"The stream '{stream.key}' to '{stream.publish_to}' is not made of keys as zenoh has them: "
            f"{str(error).partition(' at /')[0]}"
        ) from None
