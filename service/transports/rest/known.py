"""Requests in the words of an earlier one, taken straight to their operation.

A robot asks in the same words for every cloud. To find the operation, take the query apart and check fifteen
parameters costs the framework half a millisecond each time; what it found is kept here, by the path and the query.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from functools import wraps
from typing import Any, NamedTuple

from fastapi import Request, Response
from starlette.routing import BaseRoute, Match
from starlette.types import Receive, Scope, Send

from service.application import Application
from service.scopes import Scope as Allowed
from service.transports.entering import entered, key_in

KEPT = 256  # requests that differ
LONGEST = 512  # bytes of a query that is kept

Endpoint = Callable[..., Awaitable[Response]]


class _Meant(NamedTuple):
    """What a request means: the operation, its parameters, the scope that access keys need, and the route."""

    endpoint: Endpoint
    parameters: dict[str, Any]
    allowed: Allowed
    route: BaseRoute


class Known(BaseRoute):
    """Answers requests that were understood before; stands before the framework's own routes.

    Args:
        application: whose gate stands before it.
    """

    def __init__(self, application: Application) -> None:
        self._gate = application.access
        self._meant: dict[tuple[str, str, bytes], _Meant] = {}

    def remember(self, scope: Scope, meant: _Meant) -> None:
        """Keeps what a request means, unless its query is long."""
        if len(scope["query_string"]) <= LONGEST:
            if len(self._meant) >= KEPT:
                self._meant.clear()  # who asks in ever new words has nothing of this, and takes it from others rarely
            self._meant[_words(scope)] = meant

    def matches(self, scope: Scope) -> tuple[Match, Scope]:
        """Whether what a request means is known."""
        if scope["type"] == "http" and (meant := self._meant.get(_words(scope))):
            return Match.FULL, {"route": meant.route, "meant": meant}
        return Match.NONE, {}

    async def handle(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answers it."""
        meant: _Meant = scope["meant"]
        request = Request(scope, receive, send)
        key = key_in(request.headers.get("authorization", ""))
        async with entered(self._gate, key, meant.allowed) as request.state.caller:
            response = await meant.endpoint(request, **meant.parameters)
            await response(scope, receive, send)


def remembered(allowed: Allowed) -> Callable[[Endpoint], Endpoint]:
    """Has an operation's parameters kept whenever the framework has made them out.

    Args:
        allowed: scope that access keys need for it. Nothing but the query and the key may decide on a request to it.
    """

    def remembering(endpoint: Endpoint) -> Endpoint:
        @wraps(endpoint)
        async def first(request: Request, **parameters: Any) -> Response:
            scope = request.scope
            request.app.state.known.remember(scope, _Meant(endpoint, parameters, allowed, scope["route"]))
            return await endpoint(request, **parameters)

        return first

    return remembering


def _words(scope: Scope) -> tuple[str, str, bytes]:
    return scope["method"], scope["path"], scope["query_string"]
