"""Requests and answers over HTTP: JSON, and after it the tensors that are sent as bytes."""

from __future__ import annotations

import json
from typing import Any, NamedTuple

from pydantic import BaseModel, Field, StrictBool, StrictInt, StrictStr, ValidationError

from service.engine.errors import InvalidParameter, UnreadableCloud
from service.transports.open_inference import inference
from service.transports.open_inference.inference import Inference, Inferred
from service.transports.open_inference.json_data import Cut, cut_out, read_numbers
from service.transports.open_inference.tensors import to_bytes

HEADER_LENGTH = "Inference-Header-Content-Length"
BINARY_SIZE = "binary_data_size"
BINARY_OUTPUT = "binary_data_output"


class _InputParameters(BaseModel, extra="forbid"):
    binary_data_size: StrictInt | None = Field(None, ge=0)


class _Input(BaseModel):
    name: StrictStr
    datatype: StrictStr
    shape: list[StrictInt] = Field(max_length=16)
    data: Any = None
    parameters: _InputParameters = _InputParameters()


class _OutputParameters(BaseModel, extra="forbid"):
    binary_data: StrictBool | None = None
    classification: StrictInt = 0


class _Requested(BaseModel):
    name: StrictStr
    parameters: _OutputParameters = _OutputParameters()


class _Request(BaseModel):
    id: StrictStr = ""
    parameters: dict[str, Any] = {}
    inputs: list[_Input] = Field(min_length=1, max_length=1)
    outputs: list[_Requested] = []


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


def _parse(document: bytes) -> _Request:
    try:
        return _Request.model_validate_json(document)
    except ValidationError as error:
        faults = [f"{'.'.join(map(str, fault['loc'])) or 'body'}: {fault['msg']}" for fault in error.errors()[:3]]
        raise UnreadableCloud(f"The request is not one of the protocol: {'; '.join(faults)}.") from error


def _data(body: bytes, end: int, cut: Cut, given: _Input, points: int) -> bytes:
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
