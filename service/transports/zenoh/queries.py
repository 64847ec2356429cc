"""Clouds asked about by queries: the key names the model, the payload is the cloud."""

from __future__ import annotations

import asyncio
import json
import logging
import re
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from contextvars import copy_context
from functools import partial

import zenoh
from zenoh.handlers import Callback

from service.access import Caller
from service.application import Application, CloudFile
from service.engine.errors import InvalidParameter
from service.telemetry import Seen
from service.transports.errors import MEDIA_TYPE
from service.transports.request_ids import new_id
from service.transports.zenoh.attachments import Attached, attached_to
from service.transports.zenoh.encodings import format_of
from service.transports.zenoh.parameters import parse
from service.transports.zenoh.problems import check_size, problem_of

log = logging.getLogger(__name__)

SERVICE = "shape-concepts/@v1"
ASKED = re.compile(rf"{SERVICE}/(?:replicas/[^/]+/)?models/(?P<model>[^/*$]+)/respond")
JSON = "application/json"
LONGEST_NAME = 200  # characters
REPLIES = 4  # threads that send answers; one may have to wait for a client that is slow to take its own


class Queries:
    """Answers queries on `shape-concepts/@v1/models/NAME/respond`. Each gets a reply, whatever happens.

    Of several replicas, zenoh asks the nearest alone, always the same. `shape-concepts/@v1/replicas/ZID/models/NAME/
    respond` asks a particular one: for who spreads its queries, or tries another when one has too much to do.

    zenoh calls on its own threads, which must not be held up: a query is admitted or refused there, and worked on
    elsewhere. No event loop takes part, for each thread that a query goes through costs it a tenth of a millisecond.

    Args:
        application: that answers.
        session: of zenoh, open.
    """

    def __init__(self, application: Application, session: zenoh.Session) -> None:
        self._application = application
        self._replies = ThreadPoolExecutor(REPLIES, thread_name_prefix="zenoh-reply")
        self._under_way = 0
        self._changed = threading.Condition()
        handler = Callback(self._take, indirect=False)
        self._queryables = [
            session.declare_queryable(f"{place}/models/*/respond", handler, complete=True)  # complete: one is enough
            for place in (SERVICE, f"{SERVICE}/replicas/{session.zid()}")
        ]

    async def close(self) -> None:
        """Takes no more queries, and answers those that were taken."""
        for queryable in self._queryables:
            await asyncio.to_thread(queryable.undeclare)
        await asyncio.to_thread(self._wait)
        self._replies.shutdown()

    def _wait(self) -> None:
        with self._changed:
            self._changed.wait_for(lambda: not self._under_way)

    @contextmanager
    def _taken(self) -> Iterator[None]:
        with self._changed:
            self._under_way += 1
        try:
            yield
        finally:
            with self._changed:
                self._under_way -= 1
                self._changed.notify_all()

    def _take(self, query: zenoh.Query) -> None:
        """Takes a query from zenoh, or refuses it at once."""
        copy_context().run(self._admit, query)  # what is known of a request is known to its own work alone

    def _admit(self, query: zenoh.Query) -> None:
        held = ExitStack()
        seen = held.enter_context(self._application.telemetry.request("zenoh", new_id(), "respond"))
        try:
            size = _size_of(query)
            check_size(size, self._application.settings.max_body)
            held.enter_context(self._taken())
            held.enter_context(self._application.intake.opened())(size)
            held.enter_context(self._application.pool.admitted())
            self._application.pool.hand_over(partial(self._respond, query), partial(self._tell, query, held, seen))
        except BaseException as error:
            with held:
                seen.failed(error)
                _refuse(query, error, seen.request_id)

    def _tell(
        self, query: zenoh.Query, held: ExitStack, seen: Seen, answer: str | None, error: BaseException | None
    ) -> None:
        """Has a query answered by a thread that may have to wait for the client."""
        self._replies.submit(_end, query, held, seen, answer, error)

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


def _end(query: zenoh.Query, held: ExitStack, seen: Seen, answer: str | None, error: BaseException | None) -> None:
    """Answers a query, and lets go what was held for it."""
    with held:
        if answer is not None:
            _reply(query, answer)
        elif error is not None:
            seen.failed(error)
            _refuse(query, error, seen.request_id)


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
