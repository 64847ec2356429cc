"""Requests and answers over HTTP: JSON, and after it the tensors that are sent as bytes."""

from __future__ import annotations

import json
from typing import Annotated, Any, NamedTuple

from pydantic import BaseModel, Field, StrictBool, StrictInt, StrictStr, ValidationError, WithJsonSchema

from service.clouds import UNITS
from service.engine.errors import InvalidParameter, UnreadableCloud
from service.transports.open_inference import inference
from service.transports.open_inference.inference import Inference, Inferred
from service.transports.open_inference.json_data import Cut, cut_out, read_numbers
from service.transports.open_inference.signature import CLOUD, DATATYPE, OUTPUTS
from service.transports.open_inference.tensors import to_bytes

HEADER_LENGTH = "Inference-Header-Content-Length"
BINARY_SIZE = "binary_data_size"
BINARY_OUTPUT = "binary_data_output"

_NUMBER: dict[str, Any] = {"type": ["number", "null"]}
_ROW: dict[str, Any] = {"type": "array", "items": _NUMBER, "minItems": 3, "maxItems": 3}
_DATA: dict[str, Any] = {
    "oneOf": [{"type": "array", "items": _NUMBER}, {"type": "array", "items": _ROW, "minItems": 1}, {"type": "null"}]
}
_SHAPE: dict[str, Any] = {"type": "array", "items": {"type": "integer"}, "minItems": 2, "maxItems": 2}
_PARAMETERS: dict[str, Any] = {
    "type": "object",
    "properties": {
        "time": {"type": "number", "minimum": 0, "maximum": 1, "description": "filtration time of all concepts"},
        "top": {"type": "integer", "minimum": 1, "description": "how many concepts are ranked"},
        "unit": {"enum": list(UNITS), "description": "of the coordinates; metres by default"},
        "viewpoint": {
            "type": "string",
            "maxLength": inference.LONGEST_TEXT,
            "description": "pose of the sensor: x,y,z or x,y,z,qw,qx,qy,qz",
        },
        BINARY_OUTPUT: {"type": "boolean", "description": "whether tensors are to follow the JSON as bytes"},
    },
}


class InputParameters(BaseModel, extra="forbid"):
    """What is said of an input."""

    binary_data_size: StrictInt | None = Field(
        None, ge=0, description="bytes of the tensor, where it follows the JSON instead of being its `data`"
    )


class InferenceInput(BaseModel):
    """The tensor that a model takes."""

    name: Annotated[StrictStr, WithJsonSchema({"const": CLOUD})] = Field(description="of the tensor")
    datatype: Annotated[StrictStr, WithJsonSchema({"const": DATATYPE})] = Field(description="of its values")
    shape: Annotated[list[StrictInt], WithJsonSchema(_SHAPE)] = Field(
        max_length=16, description="[N, 3]: x y z of each of N points"
    )
    data: Annotated[Any, WithJsonSchema(_DATA)] = Field(
        None, description="the 3 N coordinates, row after row, or a list of rows; null where nothing was measured"
    )
    parameters: InputParameters = Field(InputParameters(), description="what is said of it")


class OutputParameters(BaseModel, extra="forbid"):
    """What is said of an output that is asked for."""

    binary_data: StrictBool | None = Field(
        None, description="whether it is to follow the JSON as bytes; by default as `binary_data_output` says"
    )
    classification: Annotated[StrictInt, WithJsonSchema({"const": 0})] = Field(0, description="there are no classes")


class RequestedOutput(BaseModel):
    """A tensor that is asked for."""

    name: Annotated[StrictStr, WithJsonSchema({"enum": list(OUTPUTS)})] = Field(description="of the tensor, once")
    parameters: OutputParameters = Field(OutputParameters(), description="how it is to be given")


class InferenceRequest(BaseModel):
    """A cloud, and what is asked about it."""

    id: Annotated[StrictStr, WithJsonSchema({"type": "string", "maxLength": inference.LONGEST_ID})] = Field(
        "", description="that the answer is to have as well"
    )
    parameters: Annotated[dict[str, Any], WithJsonSchema(_PARAMETERS)] = Field(
        {}, description="as over REST; those of Triton for scheduling have no effect"
    )
    inputs: list[InferenceInput] = Field(min_length=1, max_length=1, description="the cloud")
    outputs: list[RequestedOutput] = Field([], description="by default those that need not be asked for by name")


class Asked(NamedTuple):
    """A request, and which of its outputs the client wants as bytes, by name."""

    inference: Inference
    binary: frozenset[str]


class Body(NamedTuple):
    """The body of an answer, and how many of its bytes are JSON; None for all."""

    content: bytes
    json_length: int | None


def read_request(body: bytes, json_length: str | None, model: str, version: str, max_points: int) -> Asked:
    """Reads the body of a request.

    Args:
        body: JSON, and after it the bytes of a tensor.
        json_length: how many bytes are JSON, as the header says; None for all.
        model: as the path names it.
        version: as the path names it, "" for none.
        max_points: limit on the points.

    Raises:
        ShapeConceptsError: a child that says what is wrong with the request.
    """
    end = _json_end(body, json_length)
    cut = cut_out(body, end)
    request = _parse(cut.document)
    given = request.inputs[0]
    points = inference.check_cloud(given.name, given.datatype, given.shape, max_points)
    binary_output = request.parameters.pop(BINARY_OUTPUT, False)
    if not isinstance(binary_output, bool):
        raise InvalidParameter(f"The parameter {BINARY_OUTPUT} is true or false.")
    if any(output.parameters.classification for output in request.outputs):
        raise InvalidParameter("There are no classes: ask for 'ranking' instead of a classification.")
    outputs = inference.parse_outputs(output.name for output in request.outputs)
    wishes = {output.name: output.parameters.binary_data for output in request.outputs}
    asked = Inference(
        inference.parse_model(model),
        inference.parse_version(version),
        inference.parse_id(request.id),
        inference.parse_options(request.parameters),
        outputs,
        _data(body, end, cut, given, points),
    )
    wanted = ((name, wishes.get(name)) for name in (output.name for output in outputs))
    return Asked(asked, frozenset(name for name, wish in wanted if (binary_output if wish is None else wish)))


def write_response(inferred: Inferred, request_id: str, binary: frozenset[str]) -> Body:
    """The body that answers a request; the tensors in `binary` follow the JSON as bytes."""
    outputs: list[dict[str, Any]] = []
    tail: list[bytes] = []
    for tensor in inferred.tensors:
        told: dict[str, Any] = {"name": tensor.name, "datatype": tensor.datatype, "shape": list(tensor.values.shape)}
        if tensor.name in binary:
            tail.append(to_bytes(tensor))
            told["parameters"] = {BINARY_SIZE: len(tail[-1])}
        else:
            told["data"] = tensor.values.tolist()
        outputs.append(told)
    document: dict[str, Any] = {"model_name": inferred.model, "model_version": str(inferred.version)}
    if request_id:
        document["id"] = request_id
    head = json.dumps(document | {"outputs": outputs}, separators=(",", ":")).encode()
    return Body(b"".join([head, *tail]), len(head) if tail else None)


def _json_end(body: bytes, json_length: str | None) -> int:
    if json_length is None:
        return len(body)
    if not (json_length.isascii() and json_length.isdecimal() and len(json_length) < 20):
        raise UnreadableCloud(f"The header {HEADER_LENGTH} is the number of bytes of JSON, a whole number.")
    if int(json_length) > len(body):
        raise UnreadableCloud(
            f"The header {HEADER_LENGTH} says {json_length} bytes of JSON, but the body has {len(body)}: it was "
            "cut off."
        )
    return int(json_length)


def _parse(document: bytes) -> InferenceRequest:
    try:
        return InferenceRequest.model_validate_json(document)
    except ValidationError as error:
        faults = [f"{'.'.join(map(str, fault['loc'])) or 'body'}: {fault['msg']}" for fault in error.errors()[:3]]
        raise UnreadableCloud(f"The request is not one of the protocol: {'; '.join(faults)}.") from error


def _data(body: bytes, end: int, cut: Cut, given: InferenceInput, points: int) -> bytes:
    """The coordinates: from the bytes after the JSON, or from the JSON."""
    size = given.parameters.binary_data_size
    if size is None:
        if end < len(body):
            raise UnreadableCloud(
                f"{len(body) - end} bytes follow the JSON; their tensor needs the parameter {BINARY_SIZE}."
            )
        if given.data != cut.text:
            raise UnreadableCloud("The input has no list 'data' of numbers, nor bytes after the JSON.")
        return read_numbers(body, cut, 3 * points).astype("<f4").tobytes()
    if given.data is not None:
        raise UnreadableCloud(f"The input has both 'data' and {BINARY_SIZE}; send one of them.")
    if size != len(body) - end:
        raise UnreadableCloud(
            f"{BINARY_SIZE} says {size} bytes, but {len(body) - end} follow the JSON: the body was cut off, or the "
            f"header {HEADER_LENGTH} is missing or wrong."
        )
    inference.check_size(points, size)
    return body[end:]
