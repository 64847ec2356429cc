"""What encodings and keys say of a cloud's format."""

from __future__ import annotations

import pytest
import zenoh

from service.clouds import FORMATS
from service.engine.errors import UnsupportedFormat
from service.transports.zenoh.encodings import format_of, format_of_key


def test_every_media_type_of_a_format_is_an_encoding() -> None:
    for entry in FORMATS.values():
        for media_type in set(entry.media_types) - {"text/plain"}:
            assert format_of(zenoh.Encoding(media_type)) == entry.name


@pytest.mark.parametrize("encoding", [None, "zenoh/bytes", "zenoh/string", "text/plain", "application/octet-stream"])
def test_some_leave_it_to_the_content(encoding: str | None) -> None:
    assert format_of(None if encoding is None else zenoh.Encoding(encoding)) is None


@pytest.mark.parametrize("encoding", ["image/jpeg", "application/cdr;std_msgs/msg/String", "nonsense"])
def test_others_are_refused(encoding: str) -> None:
    with pytest.raises(UnsupportedFormat):
        format_of(zenoh.Encoding(encoding))


def test_a_key_of_rmw_zenoh_names_its_message() -> None:
    assert format_of_key("0/lidar/points/sensor_msgs::msg::dds_::PointCloud2_/RIHS01_9198") == "pointcloud2"
    assert format_of_key("0/chatter/std_msgs::msg::dds_::String_/RIHS01_1") is None
    assert format_of_key("robots/7/cloud") is None
