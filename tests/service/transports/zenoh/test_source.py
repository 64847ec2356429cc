"""Where a cloud comes from, told by attachments and headers of ROS 2."""

from __future__ import annotations

import random
import struct

import pytest
from zenoh import ext

from service.transports.zenoh.source import ros_attachment, ros_header

GID = bytes(range(16))
PLAIN = struct.pack("<qq", 7, 1_700_000_000_123_456_789) + b"\x10" + GID


def labelled(*names: str) -> bytes:
    """As rmw_zenoh of Jazzy wrote it before 0.2.4."""
    values = (names[0], ext.Int64(7), names[1], ext.Int64(1_700_000_000_123_456_789), names[2], GID)
    return ext.z_serialize(values).to_bytes()


def test_both_layouts_of_rmw_zenoh_are_read() -> None:
    assert len(PLAIN) == 33
    expected = (7, 1_700_000_000_123_456_789)
    assert ros_attachment(PLAIN) == expected
    assert ros_attachment(ext.z_serialize((ext.Int64(7), ext.Int64(expected[1]), GID)).to_bytes()) == expected
    assert ros_attachment(labelled("sequence_number", "source_timestamp", "source_gid")) == expected


@pytest.mark.parametrize(
    "attachment",
    [None, b"", b"hello", PLAIN[:-1], PLAIN + b"x", labelled("a", "b", "c"), bytes(33), b"\xff" * 33, b"\xff" * 1024],
)
def test_any_other_attachment_is_none_of_ros(attachment: bytes | None) -> None:
    assert ros_attachment(attachment) is None


def test_random_attachments_do_no_harm() -> None:
    draw = random.Random(3)
    for _ in range(2000):
        ros_attachment(draw.randbytes(draw.randrange(80)))


@pytest.mark.parametrize("order", ["<", ">"])
def test_a_header_is_read_in_both_byte_orders(order: str) -> None:
    data = bytes([0, order == "<", 0, 0]) + struct.pack(f"{order}iII", 12, 34, 6) + b"lidar\0" + b"more"
    assert ros_header(data) == (12_000_000_034, "lidar")


def test_what_is_no_header_is_none() -> None:
    good = b"\0\1\0\0" + struct.pack("<iII", 12, 34, 6) + b"lidar\0"
    assert ros_header(good) is not None
    bad = [b"", good[:15], good[:-1], b"\xff" + good[1:], b"\0\7" + good[2:], good[:-2] + b"\xff\0", good[:-1] + b"x"]
    bad += [good[:12] + struct.pack("<I", length) + good[16:] for length in (0, 7, 2**32 - 1)]
    assert [ros_header(data) for data in bad] == [None] * len(bad)
