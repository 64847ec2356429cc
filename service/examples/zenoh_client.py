"""Asks the service about clouds over zenoh: once, or as a robot does that publishes what it sees.

A service has to be there, and answer the stream (here for a robot that connects to it without a router):

    export SHAPE_CONCEPTS_ZENOH_LISTEN=tcp/127.0.0.1:7447
    export SHAPE_CONCEPTS_STREAMS='[{"key": "robots/*/cloud"}]'
    shape-concepts serve

    python service/examples/zenoh_client.py ask mug.pcd --model default
    python service/examples/zenoh_client.py ask depth.png --intrinsics 525,525,319.5,239.5 --mask mask.png
    python service/examples/zenoh_client.py publish mug.pcd --count 10

You will see the closest concepts, with the time it took; or the reason why there is no answer.
Only the package eclipse-zenoh is needed.
"""

from __future__ import annotations

import argparse
import json
import queue
import struct
import sys
import time
import uuid
from pathlib import Path
from typing import Any

import zenoh

REPLICAS = "shape-concepts/@v1/replicas/*"


def main() -> int:
    """Runs the command; the exit code is 0 if there was an answer."""
    parser = argparse.ArgumentParser(description="Asks Shape Concepts about a cloud over zenoh.")
    parser.add_argument("--connect", default="tcp/127.0.0.1:7447", metavar="ENDPOINT", help="router, or the service")
    commands = parser.add_subparsers(required=True)
    once = commands.add_parser("ask", help="ask about a cloud")
    once.add_argument("cloud", type=Path, help="PCD, PLY, XYZ, NPY or NPZ file")
    once.add_argument("--model", default="default", help="NAME, NAME@ALIAS or NAME:VERSION")
    once.add_argument("--intrinsics", help="of the camera of a depth image: fx,fy,cx,cy, pixels")
    once.add_argument("--mask", type=Path, help="of a depth image: PNG or NPY, not 0 where the object is")
    once.set_defaults(run=ask)
    often = commands.add_parser("publish", help="publish a cloud again and again, and listen to the answers")
    often.add_argument("cloud", type=Path, help="PCD, PLY, XYZ, NPY or NPZ file")
    often.add_argument("--key", default="robots/example/cloud", help="key of the stream")
    often.add_argument("--count", type=int, default=10, help="how often")
    often.add_argument("--rate", type=float, default=5.0, help="clouds a second")
    often.set_defaults(run=publish)
    arguments = parser.parse_args()

    config = zenoh.Config()
    config.insert_json5("mode", json.dumps("client"))
    config.insert_json5("connect/endpoints", json.dumps([arguments.connect]))
    config.insert_json5("scouting/multicast/enabled", "false")
    try:
        opened = zenoh.open(config)
    except zenoh.ZError:
        print(f"nobody answers at {arguments.connect}: is the router, or the service, there?", file=sys.stderr)
        return 1
    with opened as session:
        if not list(session.liveliness().get(REPLICAS, timeout=2)):
            print("nobody listens: no replica of the service is there", file=sys.stderr)
            return 1
        return int(arguments.run(session, arguments))


def ask(session: zenoh.Session, arguments: argparse.Namespace) -> int:
    """Asks about one cloud: it is the payload of a query, its mask is the attachment, and the answer is its reply."""
    selector = f"shape-concepts/@v1/models/{arguments.model}/respond?top=3"
    if arguments.intrinsics:
        selector += f";intrinsics={arguments.intrinsics}"
    # Where the service asks for an access key, this map has it as well, as "key"; or the attachment is the key alone.
    beside = zenoh.ext.z_serialize({"mask": arguments.mask.read_bytes()}) if arguments.mask else None
    for reply in session.get(selector, payload=arguments.cloud.read_bytes(), attachment=beside, timeout=30):
        if reply.ok is None and reply.err is not None:
            show(json.loads(reply.err.payload.to_bytes()))
            return 1
        if reply.ok is not None:
            show(json.loads(reply.ok.payload.to_bytes()))
            return 0
    print("no reply in time", file=sys.stderr)
    return 1


def publish(session: zenoh.Session, arguments: argparse.Namespace) -> int:
    """Publishes a cloud as a robot does, with a sequence number and the time, and shows the answers.

    The newest cloud wins: one that comes while others are at work may be dropped, and the next answer says how many.
    """
    answers: queue.Queue[dict[str, Any]] = queue.Queue()
    data, robot = arguments.cloud.read_bytes(), uuid.uuid4().bytes
    session.declare_subscriber(
        f"{arguments.key}/concepts", lambda sample: answers.put(json.loads(sample.payload.to_bytes()))
    )
    for sequence in range(arguments.count):
        # What rmw_zenoh attaches to a message: sequence number, time, and the publisher's id after its length.
        attachment = struct.pack("<qqB", sequence, time.time_ns(), len(robot)) + robot
        session.put(arguments.key, data, attachment=attachment)
        time.sleep(1 / arguments.rate)
    answered = 0
    while True:
        try:
            answer = answers.get(timeout=0 if answered == arguments.count else 5)
        except queue.Empty:
            return 0 if answered else 1
        answered += 1 + answer["dropped"]
        show(answer)


def show(answer: dict[str, Any]) -> None:
    """Prints an answer, or a problem."""
    if source := answer.get("source"):
        print(f"cloud {source['sequence']}, {answer['dropped']} dropped before it", end=": ")
    if "detail" in answer:
        print(f"{answer['title']}: {answer['detail']}")
        return
    spent = sum(answer["timings_ms"].values())
    print(f"{answer['model']}:{answer['version']}, novelty {answer['novelty']:.2f}, {spent:.0f} ms")
    for concept in answer["concepts"][:3]:
        name = concept["name"] or "without a name"
        print(f"  {concept['rank']}. concept {concept['id']} ({name}), response {concept['response']:.2f}")


if __name__ == "__main__":
    sys.exit(main())
