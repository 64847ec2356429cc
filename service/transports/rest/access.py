"""Access keys on HTTP: who may call which operation."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Annotated, Any

from fastapi import Depends, Request, Security
from fastapi.params import Depends as Dependency
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer

from service.access import Caller
from service.application import Application
from service.scopes import Scope
from service.transports.entering import entered

BEARER = HTTPBearer(
    auto_error=False,
    scheme_name="access key",
    description="An access key, made by shape-concepts keys create; not needed where only this machine can ask.",
)
READING = ("GET", "HEAD")


def needing(application: Application, scope: Scope) -> Dependency:
    """Lets callers in whose access keys allow this; for as long as a request is under way."""

    async def enter(
        request: Request, sent: Annotated[HTTPAuthorizationCredentials | None, Security(BEARER)]
    ) -> AsyncIterator[None]:
        key = sent.credentials if sent else None
        async with entered(application.access, key, scope) as request.state.caller:
            yield

    result: Any = Depends(enter)
    return result


def caller_of(request: Request) -> Caller:
    """Who sends a request that was let in."""
    caller: Caller = request.state.caller
    return caller


def reading(application: Application, *scopes: Scope, otherwise: Scope) -> Dependency:
    """As `needing`: who has one of some scopes may read, by default "answer"; who alters something needs another."""

    async def enter(
        request: Request, sent: Annotated[HTTPAuthorizationCredentials | None, Security(BEARER)]
    ) -> AsyncIterator[None]:
        any_of = (scopes or ("answer",)) if request.method in READING else (otherwise,)
        key = sent.credentials if sent else None
        async with entered(application.access, key, *any_of) as request.state.caller:
            yield

    result: Any = Depends(enter)
    return result


def without_need_of_keys(openapi: dict[str, Any]) -> dict[str, Any]:
    """The document of a service that lets everybody in: a key may be sent with each operation, and is not needed."""
    for path in openapi["paths"].values():
        for operation in path.values():
            if operation.get("security") and {} not in operation["security"]:
                operation["security"].insert(0, {})
    return openapi
