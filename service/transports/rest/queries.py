"""The parameters in the query of a request."""

from __future__ import annotations

from typing import Annotated

from fastapi import Path, Query, Request
from fastapi.routing import APIRoute
from pydantic import WithJsonSchema

from service.clouds import UNITS
from service.clouds.claims import quote
from service.engine.errors import InvalidParameter
from service.model_file import NAME

ModelQuery = Annotated[
    str | None,
    Query(max_length=200, description="NAME, NAME@ALIAS or NAME:VERSION; by default the only model of the store"),
]
VersionQuery = Annotated[int | None, Query(ge=1, le=99_999_999, description="version of the model")]
AliasQuery = Annotated[str | None, Query(max_length=63, description="alias of the model's version")]
TimeQuery = Annotated[
    float | None,
    Query(
        ge=0,
        le=1,
        description="filtration time of all concepts: 0 specific, 1 generic; by default those at the model's "
        "epsilon_max come first and the specific and generic ones of other times follow",
    ),
]
TopQuery = Annotated[int | None, Query(ge=1, description="how many concepts are listed; by default all")]
_NUMBER = r"-?[0-9]+(\.[0-9]+)?(e-?[0-9]{1,2})?"
_POSE = f"^{_NUMBER}(,{_NUMBER}){{2}}((,{_NUMBER}){{4}})?$"
UnitQuery = Annotated[
    Annotated[str, WithJsonSchema({"type": "string", "enum": list(UNITS)})] | None,
    Query(description="of the coordinates; by default the file's own, or metres"),
]
ViewpointQuery = Annotated[
    Annotated[str, WithJsonSchema({"type": "string", "pattern": _POSE})] | None,
    Query(
        max_length=300,
        description="pose of the sensor in the cloud's frame and unit: x,y,z or x,y,z,qw,qx,qy,qz",
        examples=["0.0,-0.4,-0.9"],
    ),
]
IntrinsicsQuery = Annotated[
    str | None,
    Query(
        max_length=200,
        description="of the camera of a depth image: fx,fy,cx,cy, pixels; its pixels are numbered row by row",
        examples=["525,525,319.5,239.5"],
    ),
]
DepthScaleQuery = Annotated[
    float | None,
    Query(
        gt=0,
        description="metres that a depth of 1 stands for; by default 0.001 for whole numbers and 1 for floats",
    ),
]

Name = Annotated[str, Path(pattern=f"^{NAME}$", max_length=63, description="of the model", examples=["default"])]
Reference = Annotated[
    str,
    Path(
        pattern=f"^{NAME}(@{NAME}|:[0-9]{{1,8}})?$",
        max_length=127,
        description="NAME, NAME@ALIAS or NAME:VERSION; NAME means NAME@production",
        examples=["default", "default@staging", "default:1"],
    ),
]
Qualified = Annotated[
    str,
    Path(
        pattern=f"^{NAME}(@{NAME}|:[0-9]{{1,8}})$",
        max_length=127,
        description="NAME:VERSION, or NAME@ALIAS",
        examples=["default:2", "default@staging"],
    ),
]
Version = Annotated[int, Path(ge=1, le=99_999_999, description="of the model", examples=[1])]


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
