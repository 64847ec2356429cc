"""Access keys on HTTP: who may call which operation."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

from fastapi import Depends, Request, Security
from fastapi.params import Depends as Dependency
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer

from service.application import Application
from service.scopes import Scope

BEARER = HTTPBearer(
    auto_error=False,
    scheme_name="access key",
    description="An access key, made by shape-concepts keys create; not needed where only this machine can ask.",
)
READING = ("GET", "HEAD")


def needing(application: Application, scope: Scope) -> Dependency:
    """Lets callers in whose access keys allow this; for as long as a request is under way."""

    def enter(sent: Annotated[HTTPAuthorizationCredentials | None, Security(BEARER)]) -> Iterator[None]:
        with application.access.entered(sent.credentials if sent else None, scope):
            yield

    result: Any = Depends(enter)
    return result


def reading(application: Application, *scopes: Scope, otherwise: Scope) -> Dependency:
    """As `needing`: who has one of some scopes may read, by default "answer"; who alters something needs another."""

    def enter(
        request: Request, sent: Annotated[HTTPAuthorizationCredentials | None, Security(BEARER)]
    ) -> Iterator[None]:
        any_of = (scopes or ("answer",)) if request.method in READING else (otherwise,)
        with application.access.entered(sent.credentials if sent else None, *any_of):
            yield

    result: Any = Depends(enter)
    return result
