"""Two replicas under a mixed load for minutes: every request has one whole answer, and memory stays where it was.

Clients of REST, gRPC streams and zenoh streams ask without a pause, each next one when the last is answered. The clouds
are known, and so are their answers: an answer that is lost, doubled or another cloud's is found.
"""

from __future__ import annotations

import argparse
import json
import queue
import struct
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import grpc
import httpx
import zenoh

from service.clouds import write_ply
from service.transports.grpc.generated.shapeconcepts.v1 import cloud_pb2, service_pb2
from service.transports.grpc.generated.shapeconcepts.v1.service_pb2_grpc import ShapeConceptsServiceStub
from tests.benchmarks.replicas import Replica, replica
from tests.learnt import objects
from tests.service.transports.zenoh.router import free_endpoint, routing, session

CLOUDS = 6
REST_CLIENTS, WINDOW, ROBOTS = 2, 2, 4  # REST clients a replica, open requests a gRPC stream, zenoh keys
LOST = 30.0  # seconds after which an answer that did not come is counted as lost
LOOK_EVERY = 30.0  # seconds between two rows


class Load:
    """What is asked, and what was seen of the answers.

    Args:
        clouds: files of the clouds.
        expected: the responses to each.
    """

    def __init__(self, clouds: list[bytes], expected: list[list[float]]) -> None:
        self.clouds, self.expected = clouds, expected
        self.seen: Counter[str] = Counter()
        self.ending = threading.Event()
        self._lock = threading.Lock()

    def count(self, what: str, times: int = 1) -> None:
        """Notes that something was seen."""
        with self._lock:
            self.seen[what] += times

    def judge(self, wire: str, number: int, responses: list[float]) -> None:
        """Notes an answer, and whether it is that of the cloud."""
        right = responses == self.expected[number % len(self.clouds)]
        self.count(f"{wire} answered" if right else f"{wire} WRONG")


def main(arguments: list[str]) -> None:
    """Prints a row every half minute; ends with 1 if an answer was lost, doubled or wrong."""
    parser = argparse.ArgumentParser(prog="./run bench soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    minutes = parser.parse_args(arguments).minutes
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        router = free_endpoint()
        stack.enter_context(routing(router))
        given = {"ZENOH_CONNECT": router, "STREAMS": json.dumps([{"key": "robots/*/cloud"}]), "LOG_LEVEL": "warning"}
        replicas = [stack.enter_context(replica(folder, name, **given)) for name in ("a", "b")]
        clouds = [write_ply(thing.cloud) for thing in objects()[:CLOUDS]]
        load = Load(clouds, [ask(replicas[0].http, cloud) for cloud in clouds])
        seen = soak(load, replicas, router, minutes)
    wrong = {
        what: times for what, times in seen.items() if times and not what.endswith(("answered", "refused", "dropped"))
    }
    print(f"{sum(times for what, times in seen.items() if what.endswith('answered'))} answered; {wrong or 'all well'}")
    sys.exit(bool(wrong))


def ask(address: str, cloud: bytes) -> list[float]:
    """The responses to a cloud."""
    responses: list[float] = httpx.post(f"{address}/v1/responses", content=cloud, timeout=60).json()["responses"]
    return responses


def soak(load: Load, replicas: list[Replica], router: str, minutes: float) -> Counter[str]:
    """Lets all clients ask for some minutes; returns what was seen."""
    clients = [
        threading.Thread(target=client, args=(load, one))
        for one in replicas
        for client in [ask_rest] * REST_CLIENTS + [ask_grpc]
    ]
    clients.append(threading.Thread(target=ask_zenoh, args=(load, router)))
    for client in clients:
        client.start()
    began = time.monotonic()
    while (passed := time.monotonic() - began) < 60 * minutes:
        time.sleep(min(LOOK_EVERY, 60 * minutes - passed))
        memory = " ".join(f"{one.memory():7.1f}" for one in replicas)
        print(
            f"{(time.monotonic() - began) / 60:5.1f} min  MiB {memory}  {dict(sorted(load.seen.items()))}", flush=True
        )
    load.ending.set()
    for client in clients:
        client.join()
    return load.seen


def ask_rest(load: Load, one: Replica) -> None:
    """A client that posts cloud after cloud."""
    with httpx.Client(timeout=LOST) as client:
        number = 0
        while not load.ending.is_set():
            try:
                response = client.post(f"{one.http}/v1/responses", content=load.clouds[number % CLOUDS])
            except httpx.TransportError as error:
                load.count(f"REST LOST: {type(error).__name__}")
            else:
                if response.status_code == 200:
                    load.judge("REST", number, response.json()["responses"])
                else:
                    load.count("REST refused" if response.status_code == 429 else f"REST {response.status_code}")
            number += 1


def ask_grpc(load: Load, one: Replica) -> None:
    """A client that streams clouds, with a few open at a time."""
    room, asked = threading.Semaphore(WINDOW), Counter[int]()

    def requests() -> Iterator[service_pb2.RespondStreamRequest]:
        number = 0
        while room.acquire() and not load.ending.is_set():
            file = cloud_pb2.CloudFile(data=load.clouds[number % CLOUDS])
            asked[number] += 1
            yield service_pb2.RespondStreamRequest(sequence=number, cloud=cloud_pb2.Cloud(file=file))
            number += 1

    with grpc.insecure_channel(one.grpc) as channel:
        try:
            for response in ShapeConceptsServiceStub(channel).RespondStream(requests()):
                asked[response.sequence] -= 1
                if response.HasField("answer"):
                    load.judge("gRPC", response.sequence, list(response.answer.responses))
                else:
                    load.count(f"gRPC {response.problem.type}")
                room.release()
        except grpc.RpcError as error:
            load.count(f"gRPC LOST: {error.code()}")
    for left in asked.values():
        if left:
            load.count("gRPC LOST" if left > 0 else "gRPC DOUBLED", abs(left))


def ask_zenoh(load: Load, router: str) -> None:
    """Robots that each publish the next cloud when the last is answered."""
    with session(connect=router) as robot:
        clients = [
            threading.Thread(target=stream, args=(load, robot, f"robots/{name}/cloud")) for name in range(ROBOTS)
        ]
        for client in clients:
            client.start()
        for client in clients:
            client.join()


def stream(load: Load, robot: zenoh.Session, key: str) -> None:
    """One robot."""
    answers: queue.Queue[dict] = queue.Queue()
    hearing = robot.declare_subscriber(
        f"{key}/concepts", lambda sample: answers.put(json.loads(sample.payload.to_bytes()))
    )
    time.sleep(1)  # until the router knows
    number = 0
    while not load.ending.is_set():
        attachment = struct.pack("<qqB", number, time.time_ns(), 16) + bytes(16)
        robot.put(
            key,
            load.clouds[number % CLOUDS],
            attachment=attachment,
            congestion_control=zenoh.CongestionControl.BLOCK,
        )
        until = time.monotonic() + LOST
        try:
            while (answer := answers.get(timeout=max(0.0, until - time.monotonic())))["source"]["sequence"] != number:
                load.count("zenoh DOUBLED")
            load.count("zenoh dropped", answer["dropped"])
            load.judge("zenoh", number, answer.get("responses", []))
        except queue.Empty:
            load.count("zenoh LOST")
        number += 1
    time.sleep(1)
    load.count("zenoh DOUBLED", answers.qsize())
    hearing.undeclare()
