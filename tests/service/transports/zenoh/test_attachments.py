"""What comes beside a cloud, taken apart."""

from __future__ import annotations

import random
import struct
from contextlib import suppress

import pytest
from zenoh import ext

from service.engine.errors import InvalidParameter
from service.transports.zenoh.attachments import Attached, is_ours, parse, unpack


def packed(**fields: bytes) -> bytes:
    return ext.z_serialize(fields).to_bytes()


def test_a_key_alone_is_its_text() -> None:
    assert parse(b"sc_one") == parse(b" sc_one\n") == Attached(key="sc_one")


@pytest.mark.parametrize("size", [0, 1, 127, 128, 300, 16_383, 16_384, 300_000])
def test_a_map_as_zenoh_serialises_it_has_the_mask_and_the_key(size: int) -> None:
    mask = random.Random(size).randbytes(size)
    assert unpack(packed(mask=mask, key=b"sc_one", more=b"")) == {"mask": mask, "key": b"sc_one", "more": b""}
    assert parse(packed(mask=mask)) == Attached(mask=mask)
    assert (
        parse(packed(key=b"sc_one", mask=mask)) == parse(packed(mask=mask, key=b"sc_one")) == Attached("sc_one", mask)
    )
    assert parse(packed(key=b"sc_one")) == Attached("sc_one")


WHOLE = packed(mask=bytes(200), key=b"sc_one")
MALFORMED = {
    "an end within the mask": WHOLE[:-30],
    "an end within a length": packed(mask=bytes(200))[:7],
    "something after the end": WHOLE + b"x",
    "fewer than it says": b"\x03" + WHOLE[1:],
    "more than it says": b"\x01" + WHOLE[1:],
    "a name twice": b"\x02" + packed(mask=b"1")[1:] * 2,
    "a huge length": b"\x01\x04mask" + b"\xff" * 4 + b"\x7f" + bytes(9),
    "an endless number": b"\x01\x04mask" + b"\xff" * 40,
    "another name": packed(mask=b"1", maks=b"2"),
    "other names alone": packed(maks=b"2"),
    "a key that is none": packed(key=b"x" * 2000),
    "a long text": b"x" * 2000,
    "bytes": b"\xff\xfe",
    "a mask alone": b"\x89PNG\r\n\x1a\n",
    "what ROS attaches": struct.pack("<qq", 1, 2) + b"\x10" + bytes(16),
}


@pytest.mark.parametrize("data", MALFORMED.values(), ids=MALFORMED)
def test_what_is_neither_is_refused_with_what_to_send(data: bytes) -> None:
    with pytest.raises(InvalidParameter, match="z_serialize"):
        parse(data)


def test_attachments_of_others_are_not_ours() -> None:
    assert is_ours(WHOLE)
    for sequence in (1, 2, 3, 1000):
        assert not is_ours(struct.pack("<qq", sequence, 2) + b"\x10" + bytes(16))
    assert not any(map(is_ours, (b"", b"mine", b"mask", b"\x01", b"\x89PNG")))


def test_hostile_attachments_end_at_once() -> None:
    draw = random.Random(3)
    for _ in range(3000):
        data = bytearray(WHOLE)
        for _ in range(draw.randrange(1, 6)):
            data[draw.randrange(30)] = draw.randrange(256)
        with suppress(InvalidParameter):
            parse(bytes(data))
