"""Stands before every call: names it, limits it, receives its messages, and tells its errors."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Callable, Iterable, Iterator, Mapping
from contextlib import AbstractAsyncContextManager, aclosing, contextmanager, nullcontext
from contextvars import ContextVar
from functools import partial
from typing import Any, NamedTuple

import grpc
from google.protobuf.message import DecodeError

from service.access import Caller, Gate
from service.engine.errors import Cancelled, ContentTooLarge, InvalidParameter, Overloaded, ShapeConceptsError
from service.scopes import Scope
from service.telemetry import Telemetry, Wire
from service.transports import errors
from service.transports.entering import entered, key_in
from service.transports.grpc import messages
from service.transports.grpc.generated.shapeconcepts.v1 import service_pb2
from service.transports.request_ids import name_request
from service.transports.served import asking

log = logging.getLogger(__name__)

SERVICE = service_pb2.DESCRIPTOR.services_by_name["ShapeConceptsService"].full_name
ANSWER: tuple[Scope, ...] = ("answer",)  # what a call does of which nothing else is said: it alters nothing
PACKAGE = SERVICE.rpartition(".")[0]
REQUEST_ID = "x-request-id"
DETAILS = "grpc-status-details-bin"  # where gRPC's clients look for a google.rpc.Status

_request_id: ContextVar[str] = ContextVar("request_id")


class Refusal(Exception):
    """An error of this wire alone, which no use case raises."""

    def __init__(self, kind: str, status: errors.Status, detail: str) -> None:
        super().__init__(detail)
        self.kind = kind
        self.status = status


LATE = errors.Status(408, "DEADLINE_EXCEEDED", "The request took too long to arrive")
ENDING = errors.Status(503, "UNAVAILABLE", "The service is ending", retry=errors.RETRY_AFTER)


class _Problem(NamedTuple):
    document: dict[str, Any]
    status: errors.Status


class Guard(grpc.GenericRpcHandler):
    """What every call to our services passes through; health and reflection go their own way.

    Services are put on it as on a server, and it is put on the server, as what knows the handler of any call. For each
    call that it is told of by name, a server keeps a task of the event loop, and looks at all of them with every call.

    A call's messages are received here, as bytes: so that they are waited for no longer than a request's body may take,
    and that bytes which are no message are told from an error of ours.

    Args:
        gate: lets callers in by their access keys.
        telemetry: measures every call.
        calls: how many may be open at a time.
        timeout: longest time that the one message of a call may take to arrive, seconds. A stream may be silent.
        services: names of our services.
        open: paths of the calls that need no access key.
        scopes: that calls need one of, by their paths, where it is not "answer".
        check: raises before the message of an answering call is received where there is too much to do.
        answering: paths of these calls.
    """

    def __init__(
        self,
        gate: Gate,
        telemetry: Telemetry,
        calls: int,
        timeout: float,
        services: Iterable[str] = (SERVICE,),
        open: frozenset[str] = frozenset(),
        scopes: Mapping[str, tuple[Scope, ...]] | None = None,
        check: Callable[[], None] = lambda: None,
        answering: frozenset[str] = frozenset(),
    ) -> None:
        self._check, self._answering = check, answering
        self._scopes = dict(scopes or {})
        self._ours = tuple(f"/{name}/" for name in services)
        self._unlocked = open
        self._gate = gate
        self._telemetry = telemetry
        self._limit = calls
        self._timeout = timeout
        self._open = 0
        self._unguarded: list[grpc.GenericRpcHandler] = []
        self._guarded_handlers: dict[str, Any] = {}
        self._receiving: set[asyncio.Timeout] = set()
        self._ending = asyncio.Event()
        self._none_open = asyncio.Event()
        self._none_open.set()

    async def end(self, grace: float) -> None:
        """Refuses new calls, receives no more on streams, and waits for what was accepted.

        Args:
            grace: how long at most, seconds.
        """
        self._ending.set()
        for waiting in self._receiving:
            if not waiting.expired():
                waiting.reschedule(0)  # at once
        try:
            async with asyncio.timeout(grace):
                await self._none_open.wait()
        except TimeoutError:
            log.warning("gRPC: %d calls were not answered within %g seconds", self._open, grace)

    def add_generic_rpc_handlers(self, handlers: Iterable[grpc.GenericRpcHandler]) -> None:
        """Takes a service; called by what gRPC generates for it, as of a server."""
        self._unguarded.extend(handlers)

    def add_registered_method_handlers(self, service: str, handlers: Mapping[str, Any]) -> None:
        """Called as well, with the same handlers, which are known already."""

    def service(self, call: grpc.HandlerCallDetails) -> Any:
        """The handler of a call, with the guard before it: one that reads and writes messages itself."""
        if known := self._guarded_handlers.get(call.method):
            return known
        handler = next((found for service in self._unguarded if (found := service.service(call))), None)
        if handler is None or not call.method.startswith(self._ours):
            return handler
        # One response is sent together with the status that ends the call.
        make = (
            grpc.stream_stream_rpc_method_handler
            if handler.response_streaming
            else grpc.stream_unary_rpc_method_handler
        )
        guarded = make(partial(self._guarded, handler, call.method), response_serializer=handler.response_serializer)
        self._guarded_handlers[call.method] = guarded
        return guarded

    async def _guarded(self, handler: Any, method: str, _: Any, context: Any) -> Any:
        """Answers a call; returns the response where there is one alone."""
        metadata = reversed(context.invocation_metadata() or ())  # of several of a name, the first counts
        given = {name: value for name, value in metadata if isinstance(value, str)}
        request_id = name_request(given.get(REQUEST_ID, ""))
        _request_id.set(request_id)
        context.set_trailing_metadata(((REQUEST_ID, request_id),))
        wire: Wire = "grpc" if method.startswith(f"/{PACKAGE}.") else "open-inference"
        with self._telemetry.request(wire, request_id, method, given) as seen:
            try:
                with self._entered():
                    # before any message is received
                    async with self._let_in(method, given.get("authorization", "")) as caller:
                        asking.set(caller)
                        if method in self._answering:
                            self._check()
                        return await self._behave(handler, context)
            except Exception as error:
                seen.failed(error.kind if isinstance(error, Refusal) else error)
                problem = _tell(error, request_id)
                _log(problem, error, f"{request_id} {method}")
                status = messages.to_status(*problem, request_id)
                trailing = ((REQUEST_ID, request_id), (DETAILS, status.SerializeToString()))
                await context.abort(messages.code_of(problem.status), status.message, trailing)

    @contextmanager
    def _entered(self) -> Iterator[None]:
        if self._ending.is_set():
            raise _ending()
        if self._open >= self._limit:
            raise Overloaded(f"{self._limit} calls are open already; close some, or try again in a second.")
        self._open += 1
        self._none_open.clear()
        try:
            yield
        finally:
            self._open -= 1
            if not self._open:
                self._none_open.set()

    def _let_in(self, method: str, authorization: str) -> AbstractAsyncContextManager[Caller]:
        """Asks the gate, where the call needs to be let in. The key is in `authorization: Bearer KEY`."""
        if self._gate.open or method in self._unlocked:
            return nullcontext(self._gate.anybody)
        return entered(self._gate, key_in(authorization), *self._scopes.get(method, ANSWER))

    async def _behave(self, handler: Any, context: Any) -> Any:
        if handler.request_streaming:
            responses = handler.stream_stream(self._requests(handler, context), context)
        else:
            request = await self._receive(handler, context, self._timeout)
            if request is None:
                raise InvalidParameter("The call ended without the one message that it takes.")
            if not handler.response_streaming:
                return await handler.unary_unary(request, context)
            responses = handler.unary_stream(request, context)
        async with aclosing(responses):
            async for response in responses:
                await context.write(response)
        if handler.request_streaming and self._ending.is_set():
            raise _ending()
        return None

    async def _requests(self, handler: Any, context: Any) -> AsyncIterator[Any]:
        while (request := await self._receive(handler, context, None)) is not None:
            yield request

    async def _receive(self, handler: Any, context: Any, timeout: float | None) -> Any:
        """The next message of a call; None where there is none, or the service ends.

        Raises:
            InvalidParameter: bytes that are no such message.
            ContentTooLarge: more of them than the caller may send; gRPC itself refuses what the service does not take.
            Refusal: nothing came in time.
        """
        if self._ending.is_set():
            return None
        try:
            async with asyncio.timeout(timeout) as waiting:
                self._receiving.add(waiting)
                received = await context.read()
        except TimeoutError:
            if self._ending.is_set():
                return None
            raise Refusal("request-timeout", LATE, f"The message did not arrive within {timeout:g} seconds.") from None
        finally:
            self._receiving.discard(waiting)
        if received is grpc.aio.EOF:
            return None
        if len(received) > (limit := asking.get().max_body):
            raise ContentTooLarge(
                f"The message of {len(received)} bytes is larger than the {limit} that are taken. Send fewer points, "
                "or fewer clouds at a time."
            )
        try:
            return handler.request_deserializer(received)
        except DecodeError as error:
            raise InvalidParameter(f"These {len(received)} bytes are not the message that the call takes.") from error


def problem_of(error: ShapeConceptsError) -> service_pb2.Problem:
    """An error of one cloud of several, told in the call that is being answered."""
    return messages.to_problem(*_tell(error, _request_id.get()))


def _log(problem: _Problem, error: Exception, call: str) -> None:
    if isinstance(error, Cancelled):
        log.info("%s: %s", call, error)
    elif problem.status is errors.INTERNAL:
        log.error("%s: unexpected", call, exc_info=error)
    elif problem.status.http >= 500 and problem.status is not ENDING:
        log.error("%s: %s", call, error)


def _ending() -> Refusal:
    return Refusal("ending", ENDING, "The service is ending; connect again, to another one or in a moment.")


def _tell(error: Exception, request_id: str) -> _Problem:
    if isinstance(error, ShapeConceptsError):
        return _Problem(errors.problem_of(error, request_id), errors.status_of(error))
    kind, status, detail = "internal", errors.INTERNAL, "The service failed unexpectedly; its log says more."
    if isinstance(error, Refusal):
        kind, status, detail = error.kind, error.status, str(error)
    return _Problem(errors.problem(kind, status.title, status.http, detail, request_id), status)
