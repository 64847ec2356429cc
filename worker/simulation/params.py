"""The parameters of mental simulation, with their bounds and units."""

from __future__ import annotations

from typing import Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from service.engine.errors import InvalidParameter

MAX_ORDER = 12  # compositions of more prototypes than this are larger than any camera distance allows


class _Frozen(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class PrototypeParams(_Frozen):
    """Dimensions of prototypes, and how one joins the sample so far (Alg. 1)."""

    shortest: float = Field(default=0.03, ge=0.005, le=1, description="smallest edge, height or diameter, metres")
    longest: float = Field(default=0.20, ge=0.005, le=1, description="largest edge, height or diameter, metres")
    overlap: float = Field(
        default=0.003, ge=0.001, le=0.05, description="a prototype reaches at least this deep into another, metres"
    )
    exposed: float = Field(
        default=0.1,
        ge=0,
        le=0.5,
        description="share of each prototype's surface that stays outside all others; 0 as in Alg. 1",
    )
    chord: float = Field(
        default=4e-5,
        ge=1e-6,
        le=1e-3,
        description="largest distance from a mesh to the round surface it stands for, metres",
    )

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.longest < self.shortest:
            raise ValueError(f"longest ({self.longest:g} m) is less than shortest ({self.shortest:g} m)")
        if self.overlap > self.shortest / 4:
            # Two prototypes of the smallest size would have no pose that is both deep enough and exposed enough.
            raise ValueError(f"overlap ({self.overlap:g} m) is more than a quarter of shortest ({self.shortest:g} m)")
        return self


class CameraParams(_Frozen):
    """The virtual depth camera, and where it may stand. Its axis goes through the middle of the object."""

    width: int = Field(default=640, ge=16, le=4096, description="columns of the depth image, pixels")
    height: int = Field(default=480, ge=16, le=4096, description="rows of the depth image, pixels")
    focal: float = Field(default=525.0, gt=1, le=10_000, description="focal length, pixels")
    nearest: float = Field(
        default=0.6,
        ge=0.1,
        le=10,
        description="least distance to the object's middle, metres; more where it would not fit",
    )
    farthest: float = Field(default=1.4, ge=0.1, le=10, description="largest distance to the object's middle, metres")
    lowest: float = Field(
        default=0.0, ge=-90, lt=90, description="least elevation of the camera over the object, degrees; -90: any view"
    )

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.farthest < self.nearest:
            raise ValueError(f"farthest ({self.farthest:g} m) is less than nearest ({self.nearest:g} m)")
        return self


class SensorParams(_Frozen):
    """What the Kinect does to a true depth image; unused without noise."""

    baseline: float = Field(default=0.075, gt=0, le=1, description="from projector to camera, metres")
    disparity_steps: int = Field(
        default=8, ge=1, le=256, description="steps that the sensor tells apart within a pixel"
    )
    grazing: float = Field(
        default=80.0,
        gt=30,
        lt=89,
        description="a surface seen at more than this angle to its normal returns nothing, degrees",
    )


class SimulationParams(_Frozen):
    """How abstract objects are made and seen."""

    orders: tuple[int, ...] = Field(
        default=(1, 2, 3, 4, 5), min_length=1, description="prototype orders, each for an equal number of objects"
    )
    noise: Literal["kinect", "none"] = Field(default="kinect", description="the sensor's noise")
    renderer: Literal["sapien", "raycast"] = Field(
        default="sapien", description="SAPIEN, or Open3D's ray casting where no Vulkan driver can be had"
    )
    min_points: int = Field(
        default=500, ge=1, description="an object of which the sensor sees fewer points is drawn anew"
    )
    prototypes: PrototypeParams = PrototypeParams()
    camera: CameraParams = CameraParams()
    sensor: SensorParams = SensorParams()

    @model_validator(mode="after")
    def _orders_in_range(self) -> Self:
        wrong = [order for order in self.orders if not 1 <= order <= MAX_ORDER]
        if wrong or len(set(self.orders)) < len(self.orders):
            raise ValueError(f"orders are different numbers from 1 to {MAX_ORDER}, not {list(self.orders)}")
        return self

    @classmethod
    def preset(cls, name: str) -> SimulationParams:
        """The parameters of a named preset: "default", or "paper" for Alg. 1 to the letter.

        Raises:
            InvalidParameter: there is no preset of that name.
        """
        if name == "default":
            return cls()
        if name == "paper":
            return cls(prototypes=PrototypeParams(exposed=0))
        raise InvalidParameter(f"There is no preset '{name}'; there are 'default' and 'paper'.")

    def but(self, **choices: Any) -> SimulationParams:
        """These parameters with some chosen otherwise; None leaves one as it is.

        Raises:
            InvalidParameter: a choice is out of its range.
        """
        chosen = {name: value for name, value in choices.items() if value is not None}
        try:
            return SimulationParams.model_validate({**self.model_dump(), **chosen})
        except ValidationError as error:
            said = "; ".join(f"{'.'.join(map(str, e['loc'])) or 'simulation'}: {e['msg']}" for e in error.errors())
            raise InvalidParameter(f"These simulation parameters cannot be: {said}.") from error
