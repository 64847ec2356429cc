"""What replicas tell one another of the clouds that they answer."""

from __future__ import annotations

import json

import numpy as np
import pytest

from service.live import Shown, ShownCloud
from service.streams import Stream
from service.transports.zenoh.showing import LENGTH, pack, unpack

STREAM = Stream(key="robots/*/cloud")
CLOUD = ShownCloud(
    np.arange(30, dtype=np.float32).reshape(10, 3) / 7, np.array([-1, 0, 1, 2, 3, 4, 5, 6, 7, 300], np.int16), 99
)
SHOWN = Shown(STREAM.key, "robots/7/cloud", 1.7e9 + 1 / 3, {"novelty": 1 / 7, "source": {}}, False, CLOUD)


def same(one: Shown, other: Shown) -> bool:
    if one.cloud is None or other.cloud is None:
        return one == other
    arrays = zip(one.cloud[:2], other.cloud[:2], strict=True)
    return one._replace(cloud=None) == other._replace(cloud=None) and all(np.array_equal(*pair) for pair in arrays)


@pytest.mark.parametrize(
    "shown",
    [
        SHOWN,
        SHOWN._replace(cloud=None, problem=True),
        SHOWN._replace(cloud=ShownCloud(np.zeros((0, 3), np.float32), np.zeros(0, np.int16), 0)),
    ],
)
def test_a_message_shows_what_was_packed(shown: Shown) -> None:
    assert same(unpack(STREAM, pack(shown)), shown)


def altered(**header: object) -> bytes:
    message = pack(SHOWN)
    end = LENGTH + int.from_bytes(message[:LENGTH], "little")
    said = json.dumps(json.loads(message[LENGTH:end]) | header).encode()
    return len(said).to_bytes(LENGTH, "little") + said + message[end:]


@pytest.mark.parametrize(
    "message",
    [
        b"",
        b"\xff" * 4,
        b"\xff" * 400,
        pack(SHOWN)[:-1],
        pack(SHOWN) + b"\0",
        altered(points=11),
        altered(points=-1),
        altered(points=10**9),
        altered(measured=None),
        altered(measured="many"),
        altered(key=""),
        altered(key="k" * 2000),
        altered(document=[]),
        altered(at=float("nan")),
    ],
)
def test_what_is_no_message_is_refused(message: bytes) -> None:
    with pytest.raises(ValueError, match=r"its header"):
        unpack(STREAM, message)
