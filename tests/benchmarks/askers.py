"""Clients that cost little: what they send is encoded beforehand, and of an answer they look at the status alone."""

from __future__ import annotations

import socket
from collections.abc import Callable
from typing import NamedTuple, Protocol

import grpc
import zenoh

from service.transports.grpc.generated.shapeconcepts.v1 import cloud_pb2, service_pb2
from tests.service.transports.zenoh.router import session

LOST = 60.0  # seconds after which an answer that did not come is an error
HEAD = "POST /v1/responses HTTP/1.1\r\nHost: x\r\nContent-Type: {}\r\nContent-Length: {}\r\n\r\n"
CALL = "/shapeconcepts.v1.ShapeConceptsService/Respond"
KEY = "shape-concepts/@v1/models/default/respond"


class Place(NamedTuple):
    """Where a replica can be asked: addresses HOST:PORT, and zenoh's endpoint."""

    http: str
    grpc: str
    zenoh: str


class Asker(Protocol):
    """One client of one replica."""

    def ask(self) -> bool:
        """Asks and waits; whether there was an answer: False, the service had too much to do."""


class Rest:
    """HTTP over a connection that stays open."""

    def __init__(self, place: Place, cloud: bytes, media_type: str) -> None:
        host, _, port = place.http.partition(":")
        self._request = HEAD.format(media_type, len(cloud)).encode() + cloud
        self._connection = socket.create_connection((host, int(port)), LOST)
        self._connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def ask(self) -> bool:
        """One request."""
        self._connection.sendall(self._request)
        got = self._connection.recv(1 << 16)
        while (end := got.find(b"\r\n\r\n")) < 0:
            got += self._connection.recv(1 << 16)
        head = got[:end].lower()
        start = head.index(b"content-length:") + 15
        left = int(head[start : head.find(b"\r\n", start) if b"\r\n" in head[start:] else end]) - (len(got) - end - 4)
        while left > 0:
            left -= len(self._connection.recv(1 << 16))
        status = int(head[9:12])
        if status not in (200, 429):
            raise RuntimeError(f"HTTP {status}")
        return status == 200


class Grpc:
    """gRPC over a connection of its own."""

    def __init__(self, place: Place, cloud: cloud_pb2.Cloud) -> None:
        self._request = service_pb2.RespondRequest(cloud=cloud).SerializeToString()
        # Otherwise all channels of a process to one address share a connection.
        self._channel = grpc.insecure_channel(place.grpc, options=[("grpc.use_local_subchannel_pool", 1)])
        self._call = self._channel.unary_unary(CALL)

    def ask(self) -> bool:
        """One call."""
        try:
            self._call(self._request, timeout=LOST)
        except grpc.RpcError as error:
            if error.code() is grpc.StatusCode.RESOURCE_EXHAUSTED:
                return False
            raise
        return True


class Zenoh:
    """zenoh, over a session that may have several such clients."""

    _sessions: dict[str, zenoh.Session] = {}  # noqa: RUF012 # of this process

    def __init__(self, place: Place, cloud: bytes) -> None:
        if place.zenoh not in self._sessions:
            self._sessions[place.zenoh] = session(connect=place.zenoh)
        self._session, self._cloud = self._sessions[place.zenoh], cloud

    def ask(self) -> bool:
        """One query."""
        (reply,) = self._session.get(KEY, payload=self._cloud, encoding="application/x-npy", timeout=LOST)
        if reply.ok is not None:
            return True
        if b"overloaded" in reply.err.payload.to_bytes():
            return False
        raise RuntimeError(reply.err.payload.to_string())


def points_of(npy: bytes) -> bytes:
    """The bare coordinates of an NPY file whose header has the usual length."""
    return npy[128:]


WIRES: dict[str, Callable[[Place, dict[str, bytes]], Asker]] = {
    "REST npy": lambda place, files: Rest(place, files["npy"], "application/x-npy"),
    "REST ply": lambda place, files: Rest(place, files["ply"], "application/x-ply"),
    "REST pcd": lambda place, files: Rest(place, files["pcd"], "application/x-pcd"),
    "REST json": lambda place, files: Rest(place, files["json"], "application/json"),
    "gRPC points": lambda place, files: Grpc(
        place, cloud_pb2.Cloud(points=cloud_pb2.PackedPoints(xyz=points_of(files["npy"])))
    ),
    "gRPC file": lambda place, files: Grpc(place, cloud_pb2.Cloud(file=cloud_pb2.CloudFile(data=files["npy"]))),
    "zenoh npy": lambda place, files: Zenoh(place, files["npy"]),
}
"""Each asks one cloud in one form; the files are those of the cloud by format."""
