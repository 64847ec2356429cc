"""Requests and answers over gRPC."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from service.clouds.claims import quote
from service.engine.errors import InvalidParameter, UnreadableCloud
from service.transports.open_inference import inference
from service.transports.open_inference.generated.inference import grpc_service_pb2 as pb
from service.transports.open_inference.inference import Inference, Inferred
from service.transports.open_inference.signature import CLOUD
from service.transports.open_inference.tensors import to_bytes


def read_request(request: pb.ModelInferRequest, max_points: int) -> Inference:
    """Reads a request.

    Args:
        request: as it came.
        max_points: limit on the points.

    Raises:
        ShapeConceptsError: a child that says what is wrong with it.
    """
    if len(request.inputs) != 1:
        raise InvalidParameter(f"A model takes one input, '{CLOUD}'; there were {len(request.inputs)}.")
    (given,) = request.inputs
    points = inference.check_cloud(given.name, given.datatype, given.shape, max_points)
    for tensor in (given, *request.outputs):
        if tensor.parameters:
            names = ", ".join(quote(name) for name in sorted(tensor.parameters)[:3])
            raise InvalidParameter(f"Tensors have no parameters here: no shared memory, no classes; not {names}.")
    return Inference(
        inference.parse_model(request.model_name),
        inference.parse_version(request.model_version),
        inference.parse_id(request.id),
        inference.parse_options(_parameters(request.parameters)),
        inference.parse_outputs(output.name for output in request.outputs),
        _data(request, points),
    )


def write_response(inferred: Inferred, request_id: str) -> pb.ModelInferResponse:
    """The message that answers a request."""
    return pb.ModelInferResponse(
        model_name=inferred.model,
        model_version=str(inferred.version),
        id=request_id,
        outputs=[
            pb.ModelInferResponse.InferOutputTensor(name=name, datatype=datatype, shape=values.shape)
            for name, datatype, values in inferred.tensors
        ],
        raw_output_contents=[to_bytes(tensor) for tensor in inferred.tensors],
    )


def _data(request: pb.ModelInferRequest, points: int) -> bytes:
    """The coordinates, as bytes or as the numbers of the input."""
    (given,) = request.inputs
    if request.raw_input_contents:
        if len(request.raw_input_contents) > 1 or given.HasField("contents"):
            raise UnreadableCloud("The one input has its data more than once: in raw_input_contents, or in contents.")
        data: bytes = request.raw_input_contents[0]
        inference.check_size(points, len(data))
        return data
    numbers = given.contents.fp32_contents
    if len(numbers) != 3 * points:
        raise UnreadableCloud(
            f"The tensor should have {3 * points} numbers by its shape; its fp32_contents has {len(numbers)}."
        )
    return np.array(numbers, "<f4").tobytes()


def _parameters(given: Mapping[str, pb.InferParameter]) -> dict[str, Any]:
    """The values of parameters, by name; None where there is none."""
    kinds = {name: parameter.WhichOneof("parameter_choice") for name, parameter in given.items()}
    return {name: getattr(given[name], kind) if kind else None for name, kind in kinds.items()}
