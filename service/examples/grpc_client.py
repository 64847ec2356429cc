"""Asks a running service about clouds over gRPC.

    python -m service.examples.grpc_client mug.ply
    python -m service.examples.grpc_client --address robot:8001 --model default scans/*.ply

You will see a line for each file: how new the object is to the model, and the three concepts that it resembles most,
best first, each with its response (smaller is closer). Of a file that cannot be answered you will see why, and the
exit code is 1. One file is sent as a single call. Several are sent as a stream: the service takes in a few at a time,
so that the next file is read only when there is room for it, and answers come while later files are not yet read.

Where the service asks for an access key, put it into the environment as ACCESS_KEY; where it has TLS with a certificate
of its own, name that with --certificate.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import grpc
from google.rpc.error_details_pb2 import RetryInfo
from grpc_status import rpc_status

from service.transports.grpc.generated.shapeconcepts.v1.answer_pb2 import Answer, Options
from service.transports.grpc.generated.shapeconcepts.v1.cloud_pb2 import Cloud, CloudFile
from service.transports.grpc.generated.shapeconcepts.v1.service_pb2 import RespondRequest, RespondStreamRequest
from service.transports.grpc.generated.shapeconcepts.v1.service_pb2_grpc import ShapeConceptsServiceStub

DEADLINE = 60  # seconds; the service stops working on a cloud when it has passed


def main() -> None:
    """Asks, and prints what is answered."""
    parser = argparse.ArgumentParser(description="Asks a running service about clouds over gRPC.")
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="PCD, PLY, XYZ, NPY or NPZ")
    parser.add_argument("--address", default="localhost:8001", help="of the service (default: %(default)s)")
    parser.add_argument("--model", default="", help="NAME, NAME@ALIAS or NAME:VERSION (default: the service's)")
    parser.add_argument("--certificate", type=Path, help="PEM file of who signed the service's (default: no TLS)")
    given = parser.parse_args()

    options = Options(model=given.model, top=3)
    with connect(given.address, given.certificate) as channel:
        stub = ShapeConceptsServiceStub(channel)
        try:
            if len(given.files) == 1:
                all_answered = ask(stub, given.files[0], options)
            else:
                all_answered = ask_as_stream(stub, given.files, options)
        except grpc.RpcError as error:
            all_answered = False
            print(explained(error), file=sys.stderr)
    sys.exit(0 if all_answered else 1)


def connect(address: str, certificate: Path | None) -> grpc.Channel:
    """A channel to the service, over TLS where there is a certificate to trust."""
    if certificate is None:
        return grpc.insecure_channel(address)
    return grpc.secure_channel(address, grpc.ssl_channel_credentials(certificate.read_bytes()))


def who_asks() -> list[tuple[str, str]]:
    """The metadata of every call: the access key, if there is one."""
    key = os.environ.get("ACCESS_KEY")
    return [("authorization", f"Bearer {key}")] if key else []


def ask(stub: ShapeConceptsServiceStub, file: Path, options: Options) -> bool:
    """Sends one cloud and waits for its answer."""
    request = RespondRequest(cloud=cloud_of(file), options=options)
    response = stub.Respond(request, timeout=DEADLINE, metadata=who_asks())
    print(line(file, response.answer))
    return True


def ask_as_stream(stub: ShapeConceptsServiceStub, files: list[Path], options: Options) -> bool:
    """Sends clouds one after another, and takes each answer as it comes; returns whether all were answered."""

    def requests() -> Iterator[RespondStreamRequest]:
        for number, file in enumerate(files):
            yield RespondStreamRequest(sequence=number, cloud=cloud_of(file), options=options)

    all_answered = True
    for response in stub.RespondStream(requests(), metadata=who_asks()):
        file = files[response.sequence]
        if response.HasField("answer"):
            print(line(file, response.answer))
        else:
            all_answered = False
            print(f"{file}: {response.problem.title}: {response.problem.detail}", file=sys.stderr)
    return all_answered


def cloud_of(file: Path) -> Cloud:
    """A file as it lies on the disk; points in memory would go as `PackedPoints(xyz=points.tobytes())`."""
    return Cloud(file=CloudFile(data=file.read_bytes(), name=file.name))


def line(file: Path, answer: Answer) -> str:
    """An answer in a line."""
    best = ", ".join(f"{concept.name or concept.id} ({concept.response:.1f})" for concept in answer.concepts)
    return f"{file}: novelty {answer.novelty:.2f}, concepts {best}"


def explained(error: grpc.RpcError) -> str:
    """What a call failed by, and when to try again where that helps."""
    said = f"{error.code().name}: {error.details()}"
    status = rpc_status.from_call(error)
    for detail in status.details if status else []:
        retry = RetryInfo()
        if detail.Unpack(retry):
            said += f" (try again in {retry.retry_delay.seconds} s)"
    return said


if __name__ == "__main__":
    main()
