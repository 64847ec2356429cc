"""What the encoding of a payload, or the key it came on, says of its format."""

from __future__ import annotations

import zenoh

from service.clouds import by_media_type

# Encodings of zenoh that say nothing of a cloud: its content tells.
ANY = ("zenoh/bytes", "zenoh/string", "zenoh/serialized")
ROS_CLOUD = "sensor_msgs::msg::dds_::PointCloud2_"  # chunk of the keys of rmw_zenoh, which sets no encoding
POINT_CLOUD2 = "pointcloud2"


def format_of(encoding: zenoh.Encoding | None) -> str | None:
    """The format that an encoding names, None where the content has to tell.

    Raises:
        UnsupportedFormat: it names something that is not read here.
    """
    media_type = str(encoding or "")
    return None if media_type.partition(";")[0] in ANY else by_media_type(media_type)


def format_of_key(key: str) -> str | None:
    """The format that a key names, as those of ROS 2 through rmw_zenoh do; None for others."""
    return POINT_CLOUD2 if ROS_CLOUD in key.split("/") else None
