"""Which replicas of the service live, and which of them answers what.

Every replica has a liveliness token `shape-concepts/@v1/replicas/ZID`, by which a robot sees whether anyone listens,
and one for each of its streams below it. Those that serve the same stream share it by rendezvous hashing: of the
living replicas, the one with the highest hash of (replica, item) answers an item. All see the same replicas, so all
agree without a word; and when one dies, only its items move.
"""

from __future__ import annotations

import hashlib
import threading

import zenoh
from zenoh.handlers import Callback

from service.streams import Stream

REPLICAS = "shape-concepts/@v1/replicas"


class Replicas:
    """The living replicas that serve a stream, this one among them.

    Args:
        session: of zenoh, open.
        stream: as all that share it have it, word for word.
    """

    def __init__(self, session: zenoh.Session, stream: Stream) -> None:
        self._own = str(session.zid())
        self._living = frozenset({self._own})
        self._lock = threading.Lock()
        name = name_of(stream)
        self._token = session.liveliness().declare_token(f"{REPLICAS}/{self._own}/streams/{name}")
        self._subscriber = session.liveliness().declare_subscriber(
            f"{REPLICAS}/*/streams/{name}", Callback(self._seen, indirect=False), history=True
        )

    @property
    def living(self) -> frozenset[str]:
        """Their zenoh ids."""
        return self._living

    def mine(self, item: bytes) -> bool:
        """Whether this replica is the one to answer an item."""
        return owner(self._living, item) == self._own

    def close(self) -> None:
        """Leaves; the others take over."""
        self._subscriber.undeclare()
        self._token.undeclare()

    def _seen(self, sample: zenoh.Sample) -> None:
        replica = str(sample.key_expr).split("/")[-3]
        with self._lock:
            if sample.kind == zenoh.SampleKind.PUT:
                self._living |= {replica}
            elif replica != self._own:
                self._living -= {replica}


def name_of(stream: Stream) -> str:
    """What a stream is called in keys: the same for all replicas that have it, word for word."""
    return hashlib.sha256(stream.model_dump_json().encode()).hexdigest()[:16]


def owner(replicas: frozenset[str], item: bytes) -> str:
    """The replica that answers an item: the one with the highest hash of the two.

    Args:
        replicas: ids; at least one.
        item: what is to be answered, such as a key.
    """
    return max(replicas, key=lambda replica: (hashlib.blake2b(item, key=replica.encode()[:64]).digest(), replica))
