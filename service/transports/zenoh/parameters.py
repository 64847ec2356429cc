"""The parameters of a query: those of the REST interface, after the `?` of a selector."""

from __future__ import annotations

import zenoh
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from service.application import parse_viewpoint
from service.clouds import DepthCamera, Viewpoint, parse_camera
from service.clouds.claims import quote
from service.engine.errors import InvalidParameter
from service.transports.detail import Detail, parse_detail


class Parameters(BaseModel):
    """What a query may say beside its cloud; the names and bounds are those of the REST interface."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    version: int | None = Field(None, ge=1, le=99_999_999, description="version of the model")
    alias: str | None = Field(None, max_length=63, description="alias of the model's version")
    time: float | None = Field(None, ge=0, le=1, description="filtration time of all concepts")
    top: int | None = Field(None, ge=1, description="how many concepts are listed")
    unit: str | None = Field(None, description="of the coordinates; by default the file's own, or metres")
    viewpoint: str | None = Field(None, max_length=300, description="pose of the sensor in the cloud's frame and unit")
    intrinsics: str | None = Field(None, max_length=200, description="of the camera of a depth image: fx,fy,cx,cy")
    depth_scale: float | None = Field(None, gt=0, description="metres that a depth of 1 stands for")
    detail: str | None = Field(None, max_length=200, description="parts of the answer, separated by commas, as in REST")
    stimuli: bool = Field(False, description="whether the answer has the stimuli vector as well")
    explain: bool = Field(False, description="whether the answer says why it is what it is")
    segments: bool = Field(False, description="whether it says of each point to which segment it belongs")
    scene: bool = Field(False, description="whether the cloud is a whole scene, each object on it answered")
    format: str | None = Field(None, description="of the cloud, instead of the payload's encoding")

    @property
    def pose(self) -> Viewpoint | None:
        """The viewpoint as a pose.

        Raises:
            InvalidParameter: it is none.
        """
        return None if self.viewpoint is None else parse_viewpoint(self.viewpoint)

    @property
    def parts(self) -> Detail:
        """The parts of the answer that are asked for.

        Raises:
            InvalidParameter: there is no such part.
        """
        given = None if self.detail is None else [self.detail]
        return parse_detail(given, stimuli=self.stimuli, segments=self.segments, explain=self.explain)

    @property
    def camera(self) -> DepthCamera | None:
        """The camera of a depth image.

        Raises:
            InvalidParameter: its intrinsics are none.
        """
        return parse_camera(self.intrinsics, self.depth_scale)


def parse(selected: zenoh.Parameters) -> Parameters:
    """The parameters of a selector. Those that begin with "_" are zenoh's own.

    Raises:
        InvalidParameter: one is unknown, given twice, of the wrong kind or out of its range.
    """
    given: dict[str, str] = {}
    for name, value in list(selected):  # type: ignore[call-overload] # iterates, unlike what its types say
        if name.startswith("_"):
            continue
        if name not in Parameters.model_fields:
            known = ", ".join(Parameters.model_fields)
            raise InvalidParameter(f"There is no parameter {quote(name)}; there are {known}.")
        if name in given:
            raise InvalidParameter(f"The parameter '{name}' is given twice.")
        given[name] = value
    try:
        return Parameters.model_validate(given)
    except ValidationError as error:
        said = [f"{'.'.join(map(str, fault['loc']))}: {fault['msg']}" for fault in error.errors()]
        raise InvalidParameter("; ".join(said) + ". Parameters are separated by semicolons, ?top=1;time=0.5.") from None
