"""The parameters in the query of a request."""

from __future__ import annotations

from fastapi import Request
from fastapi.routing import APIRoute

from service.clouds.claims import quote
from service.engine.errors import InvalidParameter


async def known_only(request: Request) -> None:
    """Refuses a request with a parameter that its operation has not: it was misspelt, and would be without effect.

    Raises:
        InvalidParameter: there is one; the message says which there are.
    """
    route = request.scope["route"]
    assert isinstance(route, APIRoute)
    known = [parameter.alias for parameter in route.dependant.query_params]
    unknown = [quote(name) for name in request.query_params if name not in known]
    if unknown:
        there_are = f"there are {', '.join(known)}" if known else "there are none here"
        raise InvalidParameter(f"There is no parameter {' or '.join(unknown[:5])}; {there_are}.")
