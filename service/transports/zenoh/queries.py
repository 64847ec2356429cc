"""Clouds asked about by queries: the key names the model, the payload is the cloud."""

from __future__ import annotations

import asyncio
import json
import logging
import re
import uuid
from concurrent.futures import Future
from contextlib import ExitStack

import zenoh
from zenoh.handlers import Callback

from service.access import Caller
from service.application import Application, CloudFile
from service.engine.errors import InvalidParameter
from service.transports.errors import MEDIA_TYPE
from service.transports.zenoh.attachments import Attached, attached_to
from service.transports.zenoh.encodings import format_of
from service.transports.zenoh.parameters import parse
from service.transports.zenoh.problems import check_size, problem_of

log = logging.getLogger(__name__)

SERVICE = "shape-concepts/@v1"
ASKED = re.compile(rf"{SERVICE}/(?:replicas/[^/]+/)?models/(?P<model>[^/*$]+)/respond")
JSON = "application/json"
LONGEST_NAME = 200  # characters


class Queries:
    """Answers queries on `shape-concepts/@v1/models/NAME/respond`. Each gets a reply, whatever happens.

    Of several replicas, zenoh asks the nearest alone, always the same. `shape-concepts/@v1/replicas/ZID/models/NAME/
    respond` asks a particular one: for who spreads its queries, or tries another when one has too much to do.

    zenoh calls on its own threads, which must not be held up: a query is admitted or refused there, and worked on
    elsewhere.

    Args:
        application: that answers.
        session: of zenoh, open.
        loop: on which work is awaited.
    """

    def __init__(self, application: Application, session: zenoh.Session, loop: asyncio.AbstractEventLoop) -> None:
        self._application = application
        self._loop = loop
        self._under_way: set[Future[None]] = set()
        handler = Callback(self._take, indirect=False)
        self._queryables = [
            session.declare_queryable(f"{place}/models/*/respond", handler, complete=True)  # complete: one is enough
            for place in (SERVICE, f"{SERVICE}/replicas/{session.zid()}")
        ]

    async def close(self) -> None:
        """Takes no more queries, and answers those that were taken."""
        for queryable in self._queryables:
            await asyncio.to_thread(queryable.undeclare)
        while self._under_way:
            await asyncio.gather(*map(asyncio.wrap_future, list(self._under_way)), return_exceptions=True)

    def _take(self, query: zenoh.Query) -> None:
        """Takes a query from zenoh, or refuses it at once."""
        held = ExitStack()
        try:
            size = _size_of(query)
            check_size(size, self._application.settings.max_body)
            held.enter_context(self._application.intake.opened())(size)
            held.enter_context(self._application.pool.admitted())
            work = asyncio.run_coroutine_threadsafe(self._answer(query, held), self._loop)
        except BaseException as error:
            held.close()
            with self._application.telemetry.request("zenoh", str(uuid.uuid4()), "respond") as seen:
                seen.failed(error)
                _refuse(query, error, seen.request_id)
            return
        self._under_way.add(work)
        work.add_done_callback(self._under_way.discard)

    async def _answer(self, query: zenoh.Query, held: ExitStack) -> None:
        """Answers a query that was admitted."""
        with held, self._application.telemetry.request("zenoh", str(uuid.uuid4()), "respond") as seen:
            try:
                answer = await self._application.pool.run(self._respond, query)
            except BaseException as error:
                seen.failed(error)
                await asyncio.to_thread(_refuse, query, error, seen.request_id)
                if not isinstance(error, Exception):
                    raise
            else:
                await asyncio.to_thread(_reply, query, answer)

    def _respond(self, query: zenoh.Query) -> str:
        attached: Attached | InvalidParameter
        try:
            attached = attached_to(query)
        except InvalidParameter as error:
            attached = error
        key = None if isinstance(attached, Exception) else attached.key
        with self._application.access.entered(key, "answer") as caller:  # who is not let in is told nothing else
            if isinstance(attached, Exception):
                raise attached
            check_size(_size_of(query), caller.max_body)
            return self._answered(query, attached.mask, caller)

    def _answered(self, query: zenoh.Query, mask: bytes | None, caller: Caller) -> str:
        asked = parse(query.parameters)
        model = _model_of(str(query.key_expr))
        data = b"" if query.payload is None else query.payload.to_bytes()
        format = asked.format or format_of(query.encoding)
        cloud = CloudFile(data, format, unit=asked.unit, viewpoint=asked.pose, camera=asked.camera, mask=mask)
        parts = asked.parts
        respond = self._application.respond_scene if asked.scene else self._application.respond
        answer = respond(
            cloud,
            model=model,
            version=asked.version,
            alias=asked.alias,
            time=asked.time,
            top=asked.top,
            stimuli=parts.stimuli,
            explain=parts.explanation,
            segments=parts.segments,
            max_points=caller.max_points,
        )
        return answer.model_dump_json(exclude=parts.exclude(scene=asked.scene))


def _size_of(query: zenoh.Query) -> int:
    """Bytes of a query's cloud and of what comes beside it."""
    return sum(len(part) for part in (query.payload, query.attachment) if part is not None)


def _model_of(key: str) -> str:
    """The model that a query's key names."""
    found = ASKED.fullmatch(key)
    if found is None or len(found["model"]) > LONGEST_NAME:
        raise InvalidParameter(f"Ask one model at a time, on {SERVICE}/models/NAME/respond; the key was '{key[:200]}'.")
    return found["model"]


def _reply(query: zenoh.Query, answer: str) -> None:
    with query:
        try:
            query.reply(query.key_expr, answer, encoding=JSON)
        except zenoh.ZError as error:
            log.warning("an answer could not be sent: %s", error)


def _refuse(query: zenoh.Query, error: BaseException, request_id: str) -> None:
    with query:
        try:
            query.reply_err(json.dumps(problem_of(error, str(query.key_expr), request_id)), encoding=MEDIA_TYPE)
        except zenoh.ZError as failure:
            log.warning("an error could not be told: %s", failure)
