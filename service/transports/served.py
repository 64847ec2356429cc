"""A gRPC service that a transport has answered on the server of another, and who asks it."""

from __future__ import annotations

from collections.abc import Callable
from contextvars import ContextVar
from typing import Any, NamedTuple

from service.access import Caller

asking: ContextVar[Caller] = ContextVar("asking")  # set by the server for the length of a call


class Served(NamedTuple):
    """A service, as it is put on a server.

    Attributes:
        name: in full, with its package.
        add: puts it on a server.
        open: names of its calls that need no access key.
    """

    name: str
    add: Callable[[Any], None]
    open: frozenset[str] = frozenset()
