"""Streams of clouds that robots publish, as an operator describes them."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator

KEY = "{key}"
LONGEST_LATENCY = 3600.0  # seconds; beyond, the clocks of robot and watcher do not agree


class Stream(BaseModel):
    """Clouds that are answered as they arrive, each on a key beside its own."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    key: str = Field(
        min_length=1,
        max_length=1000,
        description="zenoh key expression of the clouds, e.g. 0/**/sensor_msgs::msg::dds_::PointCloud2_/*",
    )
    model: str | None = Field(None, description="NAME, NAME@ALIAS or NAME:VERSION; by default the service's model")
    format: str | None = Field(
        None, description="of the clouds; by default the key, then the encoding, then the content tells"
    )
    unit: str | None = Field(None, description="of the coordinates; by default their own, or metres")
    frame: Literal["optical", "body"] = Field(
        "optical",
        description="axes of the sensor: optical has x right, y down, z forward; body, as ROS has it, x forward, "
        "y left, z up",
    )
    viewpoint: str | None = Field(
        None,
        description="pose of the sensor in the clouds' frame and unit, instead of a frame: x,y,z or x,y,z,qw,qx,qy,qz",
    )
    intrinsics: str | None = Field(
        None,
        max_length=200,
        description="of the camera whose depth images these are: fx,fy,cx,cy, pixels; a mask may come with each",
    )
    depth_scale: float | None = Field(None, gt=0, description="metres that a depth of 1 of these stands for")
    scene: bool = Field(False, description="whether the clouds are whole scenes: each object on a plane is answered")
    time: float | None = Field(None, ge=0, le=1, description="filtration time of the concepts; by default epsilon_max")
    top: int | None = Field(None, ge=1, description="how many concepts an answer lists; by default all")
    publish_to: str = Field(
        f"{KEY}/concepts", description=f"key of the answers; {KEY} is the key that the cloud came on"
    )
    share: Literal["key", "cloud"] = Field(
        "key",
        description="what replicas share out among themselves: keys, so that each robot's clouds are answered in "
        "order by one of them, or single clouds, for a stream that is too much for one",
    )

    @field_validator("publish_to")
    @classmethod
    def _names_the_key(cls, value: str) -> str:
        if value.count(KEY) != 1 or value == KEY:
            raise ValueError(f"it should have {KEY} once, and more beside it, such as {KEY}/concepts")
        return value

    def answers_on(self, key: str) -> str:
        """The key of the answers to the clouds of a key."""
        return self.publish_to.replace(KEY, key)

    def is_answer(self, key: str) -> bool:
        """Whether a key looks like one of this stream's answers, which are no clouds."""
        before, _, after = self.publish_to.partition(KEY)
        return len(key) > len(before) + len(after) and key.startswith(before) and key.endswith(after)


def latency_of(sent_ns: object, now_ns: int) -> float | None:
    """How long ago a robot published a cloud, by its own clock and ours, seconds; None where that cannot be told.

    Args:
        sent_ns: when it says that it did, nanoseconds since 1970; anything else where it did not say.
        now_ns: when it is now.
    """
    latency_ns = now_ns - sent_ns if isinstance(sent_ns, int) else -1  # of any size: it is what somebody wrote
    return latency_ns / 1e9 if 0 <= latency_ns < LONGEST_LATENCY * 1e9 else None
