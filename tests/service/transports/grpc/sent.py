"""Clouds as gRPC clients send them, and how refusals are read."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import grpc
import pytest
from google.rpc import error_details_pb2 as details
from grpc_status import rpc_status

from service.clouds import write_ply
from service.engine.cloud import PointCloud
from service.transports.grpc.generated.shapeconcepts.v1.cloud_pb2 import (
    Cloud,
    CloudFile,
    PackedPoints,
)
from service.transports.grpc.generated.shapeconcepts.v1.service_pb2_grpc import ShapeConceptsServiceStub

Stub = ShapeConceptsServiceStub


def as_file(cloud: PointCloud, name: str = "") -> Cloud:
    return Cloud(file=CloudFile(data=write_ply(cloud), name=name))


def as_points(cloud: PointCloud) -> Cloud:
    return Cloud(points=PackedPoints(xyz=cloud.points.astype("<f4").tobytes()))


def refused(call: Callable[[], Any]) -> tuple[grpc.RpcError, details.ErrorInfo]:
    with pytest.raises(grpc.RpcError) as caught:
        call()
    error = caught.value
    status = rpc_status.from_call(error)
    assert status is not None, error
    info, request = details.ErrorInfo(), details.RequestInfo()
    assert status.details[0].Unpack(info)
    assert status.details[1].Unpack(request)
    assert info.domain == "shape-concepts"
    assert dict(error.trailing_metadata())["x-request-id"] == request.request_id
    assert info.metadata["instance"] == f"urn:uuid:{request.request_id}"
    assert len(error.details()) > 10
    return error, info


def file(data: bytes, format: str = "", **given: Any) -> Cloud:
    return Cloud(file=CloudFile(data=data, format=format), **given)


XYZ = file(b"0.1 0.2 0.9\n")
