"""Where a cloud of a stream comes from: its key, and the sequence number and time that came with it."""

from __future__ import annotations

import re
import struct
from typing import Any, NamedTuple

import zenoh

from service.transports.zenoh.attachments import is_ours

LARGEST_ATTACHMENT = 1024  # bytes; larger ones are not carried over
_PLAIN = re.compile(rb"(.{8})(.{8})\x10.{16}", re.DOTALL)
_LABELLED = re.compile(rb"\x0fsequence_number(.{8})\x10source_timestamp(.{8})\x0asource_gid\x10.{16}", re.DOTALL)


class Source(NamedTuple):
    """Where a cloud comes from.

    Attributes:
        key: that it was published on.
        sequence: its number, counted by its publisher; None where it gave none.
        time_ns: when it was published, nanoseconds since 1970 by the publisher's clock; None where it did not say.
        frame_id: frame of its coordinates, if it is a ROS message.
        stamp_ns: when it was measured, nanoseconds since 1970, if it is a ROS message.
    """

    key: str
    sequence: int | None
    time_ns: int | None
    frame_id: str | None = None
    stamp_ns: int | None = None

    def told(self) -> dict[str, Any]:
        """As an answer says it."""
        return self._asdict()


class Header(NamedTuple):
    """The header of a ROS message.

    Attributes:
        stamp_ns: nanoseconds since 1970.
        frame_id: name of the frame.
    """

    stamp_ns: int
    frame_id: str


def source_of(sample: zenoh.Sample, attachment: bytes | None) -> Source:
    """Where a sample comes from, by its attachment if that is one of ROS 2, else by what zenoh knows."""
    sequence, time_ns = ros_attachment(attachment) or (None, None)
    if sequence is None and sample.source_info is not None:
        sequence = int(sample.source_info.source_sn)
    if time_ns is None and sample.timestamp is not None:
        time_ns = sample.timestamp.get_time_as_ntp64().as_nanos()
    return Source(str(sample.key_expr), sequence, time_ns)


def attachment_of(sample: zenoh.Sample) -> bytes | None:
    """The attachment that an answer carries over; None if there is none, a large one, or a mask."""
    attachment = sample.attachment
    if attachment is None or len(attachment) > LARGEST_ATTACHMENT:
        return None
    data = attachment.to_bytes()
    return None if is_ours(data) else data


def ros_attachment(attachment: bytes | None) -> tuple[int, int] | None:
    """Sequence number and source time (ns) in the attachment of rmw_zenoh; None for any other attachment.

    It is an int64, an int64, and 16 bytes after their number; before version 0.2.4, Jazzy's put a label, after the
    number of its letters, before each. It is taken apart here because zenoh's own deserialisation aborts the process
    when the attachment claims a huge length.
    """
    for layout in (_PLAIN, _LABELLED):
        if attachment is not None and (found := layout.fullmatch(attachment)):
            sequence, time_ns = (int.from_bytes(part, "little", signed=True) for part in found.groups())
            return sequence, time_ns
    return None


def ros_header(data: bytes) -> Header | None:
    """The header at the beginning of a ROS message in CDR; None if there is none that can be read.

    After the encapsulation (4 bytes, the second of which tells the byte order) follow the seconds (int32),
    nanoseconds (uint32), and the length (uint32) and bytes of the frame's name, closed by a zero.
    """
    if len(data) < 16 or data[0] != 0 or data[1] not in (0, 1):
        return None
    order = "<" if data[1] else ">"
    seconds, nanoseconds, length = struct.unpack_from(f"{order}iII", data, 4)
    name = data[16 : 16 + length]
    if not 1 <= length <= 256 or len(name) < length or name[-1:] != b"\0":
        return None
    try:
        return Header(seconds * 10**9 + nanoseconds, name[:-1].decode())
    except UnicodeDecodeError:
        return None
