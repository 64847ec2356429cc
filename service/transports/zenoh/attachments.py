"""What comes beside a cloud as zenoh's attachment: an access key, the mask of a depth image, or both.

An access key alone is its text. A mask comes in a map from names to bytes as all of zenoh's serialisers write it, in
Python `zenoh.ext.z_serialize({"mask": mask})`: how many there are, then each name and each value after its length; all
numbers in LEB128, seven bits a byte, the lowest first. It is taken apart here because zenoh's own deserialisation
aborts the process when a length is huge.
"""

from __future__ import annotations

import re
from typing import NamedTuple

import zenoh

from service.engine.errors import InvalidParameter

KEY = "key"
MASK = "mask"
LONGEST_KEY = 1024  # bytes
LONGEST_NUMBER = 5  # bytes of a length: more than any message has
_OURS = re.compile(rb"[\0-\x1f](?:\x03key|\x04mask)")  # how a map begins that has one of our names


class Attached(NamedTuple):
    """What an attachment brings.

    Attributes:
        key: an access key.
        mask: the file of a depth image's mask.
    """

    key: str | None = None
    mask: bytes | None = None


def attached_to(query: zenoh.Query) -> Attached:
    """What a query brings beside its cloud.

    Raises:
        InvalidParameter: something else than is known.
    """
    return Attached() if query.attachment is None else parse(query.attachment.to_bytes())


def mask_of(sample: zenoh.Sample) -> bytes | None:
    """The mask that a cloud of a stream comes with; other attachments are its publisher's own.

    Raises:
        InvalidParameter: a map with a mask that is malformed.
    """
    data = b"" if sample.attachment is None else sample.attachment.to_bytes()
    return parse(data).mask if is_ours(data) else None


def is_ours(data: bytes) -> bool:
    """Whether an attachment begins as a map with an access key or a mask does."""
    return _OURS.match(data) is not None


def parse(data: bytes) -> Attached:
    """What an attachment of a query brings.

    Raises:
        InvalidParameter: it is neither the text of a key nor such a map.
    """
    if not is_ours(data):
        try:
            text = data[: LONGEST_KEY + 1].decode().strip()
        except UnicodeDecodeError:
            raise _unknown("it is neither text nor such a map") from None
        if len(data) > LONGEST_KEY or not text.isprintable():
            raise _unknown("it is neither a line of text nor such a map")
        return Attached(key=text)
    fields = unpack(data)
    if others := fields.keys() - {KEY, MASK}:
        raise _unknown(f"it has the name '{min(others)[:60]}'")
    key = fields.get(KEY)
    if key is not None and len(key) > LONGEST_KEY:
        raise _unknown(f"its key has {len(key)} bytes")
    return Attached(None if key is None else key.decode(errors="replace").strip(), fields.get(MASK))


def unpack(data: bytes) -> dict[str, bytes]:
    """A map from names to bytes, as zenoh serialises it.

    Raises:
        InvalidParameter: it is malformed, or has a name twice.
    """
    count, at = _number(data, 0)
    fields: dict[str, bytes] = {}
    for _ in range(min(count, len(data))):
        name, at = _octets(data, at)
        value, at = _octets(data, at)
        fields[name.decode(errors="replace")] = value
    if at < len(data) or len(fields) != count:
        raise _unknown(f"{len(data) - at} bytes are left over" if at < len(data) else "a name is there twice")
    return fields


def _octets(data: bytes, at: int) -> tuple[bytes, int]:
    length, begin = _number(data, at)
    if length > len(data) - begin:
        raise _unknown(f"it ends within {length} bytes")
    return data[begin : begin + length], begin + length


def _number(data: bytes, at: int) -> tuple[int, int]:
    number = 0
    for place, byte in enumerate(data[at : at + LONGEST_NUMBER]):
        number |= (byte & 0x7F) << (7 * place)
        if byte < 0x80:
            return number, at + place + 1
    raise _unknown("it ends within a number, or a number is too large")


def _unknown(fault: str) -> InvalidParameter:
    return InvalidParameter(
        "The attachment should be an access key, or a map with 'mask' and, where one is needed, 'key', as "
        f'zenoh.ext.z_serialize({{"mask": mask}}) makes it; {fault}.'
    )
