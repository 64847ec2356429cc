"""What is below /v2, as OpenAPI describes it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from http import HTTPStatus
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field
from pydantic.json_schema import models_json_schema

from service.transports.open_inference.rest_messages import HEADER_LENGTH, InferenceRequest
from service.transports.open_inference.signature import CLOUD, DATATYPE, OUTPUTS, SERVER, describe

TAG = "open inference"
REFERENCES = "#/components/schemas/{model}"
MODEL = "/v2/models/{model}"
VERSION = MODEL + "/versions/{version}"
KEYS = (401, 403, 429, 503)  # what the access keys of callers bring about, and their store
READING = (404, 422, 500)
INFERRING = (400, 404, 408, 413, 415, 422, 500)

_EXACT = ConfigDict(extra="forbid")


class InferenceServer(BaseModel):
    """What the service is."""

    model_config = _EXACT

    name: str = Field(description="of the service")
    version: str = Field(description="of the service")
    extensions: list[str] = Field(description="of the protocol, that it knows")


class InferenceLive(BaseModel):
    """That the service runs."""

    model_config = _EXACT

    live: Literal[True] = Field(description="whether it does")


class InferenceReady(BaseModel):
    """That the service has a model to answer with."""

    model_config = _EXACT

    ready: Literal[True] = Field(description="whether it has")


class InferenceModelReady(BaseModel):
    """That a model can answer."""

    model_config = _EXACT

    name: str = Field(description="of the model")
    ready: Literal[True] = Field(description="whether it can")


class TensorMetadata(BaseModel):
    """A tensor that a model takes or gives."""

    model_config = _EXACT

    name: str = Field(description="of the tensor")
    datatype: str = Field(description="of its values")
    shape: list[int] = Field(description="of the tensor; -1 for a size that depends on the cloud or the model")


class InferenceModel(BaseModel):
    """What a model takes and gives."""

    model_config = _EXACT

    name: str = Field(description="of the model")
    versions: list[str] = Field(description="that there are, or the one that was asked about")
    platform: str = Field(description="what made it")
    inputs: list[TensorMetadata] = Field(description="what it takes")
    outputs: list[TensorMetadata] = Field(description="what it gives")


class GivenParameters(BaseModel):
    """What is said of a tensor that is given."""

    model_config = _EXACT

    binary_data_size: int = Field(description="bytes of the tensor, which follows the JSON")


class GivenTensor(BaseModel):
    """A tensor that is given: as `data`, or, after the JSON, as bytes."""

    model_config = _EXACT

    name: Literal[tuple(OUTPUTS)] = Field(description="of the tensor")  # type: ignore[valid-type] # known at run time
    datatype: str = Field(description="of its values")
    shape: list[int] = Field(description="of the tensor")
    data: list[float | bool | str] = Field([], description="its values")
    parameters: GivenParameters | None = Field(None, description="where its bytes are")


class InferenceResponse(BaseModel):
    """The answer to a cloud."""

    model_config = _EXACT

    model_name: str = Field(description="of the model that answered")
    model_version: str = Field(description="its version")
    id: str = Field("", description="that of the request, if it had one")
    outputs: list[GivenTensor] = Field(description="the tensors, in the order in which they were asked for")


class InferenceError(BaseModel):
    """Why there is no answer."""

    model_config = _EXACT

    error: str = Field(description="what was wrong, and what to try")


ANSWERS = (InferenceServer, InferenceLive, InferenceReady, InferenceModel, InferenceModelReady, InferenceResponse)


def can(radius: float = 0.04, height: float = 0.12, distance: float = 0.6) -> list[float]:
    """Coordinates (3 N) of a can's side that faces the sensor, metres, row after row: an example of a cloud."""
    places = [(math.pi * turn / 11, height * step / 11) for step in range(12) for turn in range(12)]
    points = [(radius * math.cos(a), h - height / 2, distance - radius * math.sin(a)) for a, h in places]
    return [round(value, 4) for point in points for value in point]


EXAMPLE: dict[str, Any] = {
    "id": "7",
    "parameters": {"top": 2},
    "inputs": [{"name": CLOUD, "datatype": DATATYPE, "shape": [len(can()) // 3, 3], "data": can()}],
    "outputs": [{"name": "novelty"}, {"name": "ranking"}],
}
EXAMPLES: dict[type[BaseModel], dict[str, Any]] = {
    InferenceServer: SERVER,
    InferenceLive: {"live": True},
    InferenceReady: {"ready": True},
    InferenceModel: describe("default", [1]),
    InferenceModelReady: {"name": "default", "ready": True},
    InferenceResponse: {
        "model_name": "default",
        "model_version": "1",
        "id": "7",
        "outputs": [
            {"name": "novelty", "datatype": "FP64", "shape": [1], "data": [0.64]},
            {"name": "ranking", "datatype": "INT64", "shape": [2], "data": [1, 4]},
        ],
    },
}


def describe_in(description: dict[str, Any]) -> dict[str, Any]:
    """Adds what is below /v2 to the OpenAPI description of everything else, whose access keys open it as well."""
    components = description["components"]
    keys: list[dict[str, list[str]]] = [{name: []} for name in components.get("securitySchemes", {})]
    _, schemas = models_json_schema(
        [(InferenceRequest, "validation"), *((each, "validation") for each in (*ANSWERS, InferenceError))],
        ref_template=REFERENCES,
    )
    components["schemas"] |= schemas["$defs"]
    description["paths"] |= _paths(keys)
    return description


def _paths(keys: list[dict[str, list[str]]]) -> dict[str, Any]:
    def reading(summary: str, path: str, answer: type[BaseModel], statuses: Iterable[int]) -> dict[str, Any]:
        return {"get": _operation(summary, path, "get", answer, (*KEYS, *statuses), keys)}

    paths = {
        "/v2": reading("What is the service?", "/v2", InferenceServer, (500,)),
        "/v2/health/live": {
            "get": _operation("Does the service run?", "/v2/health/live", "get", InferenceLive, (), [])
        },
        "/v2/health/ready": {
            "get": _operation("Is there a model?", "/v2/health/ready", "get", InferenceReady, (500, 503), [])
        },
    }
    for path in (MODEL, VERSION):
        paths[path] = reading("What does a model take and give?", path, InferenceModel, READING)
        ready, infer = f"{path}/ready", f"{path}/infer"
        paths[ready] = reading("Can a model answer?", ready, InferenceModelReady, READING)
        asked = _operation(
            "Which concepts does a cloud resemble?", infer, "post", InferenceResponse, (*KEYS, *INFERRING), keys
        )
        paths[infer] = {"post": _inferring(asked)}
    return paths


def _operation(
    summary: str, path: str, method: str, answer: type[BaseModel], statuses: Iterable[int], keys: list[Any]
) -> dict[str, Any]:
    schema = {"$ref": REFERENCES.format(model=answer.__name__)}
    good = {"description": "Success", "content": {"application/json": {"schema": schema, "example": EXAMPLES[answer]}}}
    described: dict[str, Any] = {
        "tags": [TAG],
        "summary": summary,
        "description": "After the Open Inference Protocol, version 2.",
        "operationId": f"{method}{path}".translate(str.maketrans("/{}", "___")),
        "parameters": [parameter for name, parameter in _PARAMETERS.items() if f"{{{name}}}" in path],
        "responses": {"200": good} | {str(status): _refused(status) for status in sorted(set(statuses))},
    }
    return described | ({"security": keys} if keys else {})


_PARAMETERS: dict[str, dict[str, Any]] = {
    "model": {
        "name": "model",
        "in": "path",
        "required": True,
        "description": "NAME, or NAME@ALIAS; NAME means NAME@production",
        "schema": {"type": "string", "maxLength": 127, "pattern": "^[a-z0-9][a-z0-9-]*(@[a-z0-9][a-z0-9-]*)?$"},
        "example": "default",
    },
    "version": {
        "name": "version",
        "in": "path",
        "required": True,
        "description": "of the model, from 1",
        "schema": {"type": "string", "pattern": "^[0-9]{1,8}$"},
        "example": "1",
    },
}


def _refused(status: int) -> dict[str, Any]:
    schema, phrase = {"$ref": REFERENCES.format(model=InferenceError.__name__)}, HTTPStatus(status).phrase
    return {
        "description": phrase,
        "content": {
            "application/json": {"schema": schema, "example": {"error": f"{phrase}: what to try is said here."}}
        },
    }


def _inferring(operation: dict[str, Any]) -> dict[str, Any]:
    """An operation that takes a cloud, as JSON alone or with the bytes of tensors after it."""
    length: dict[str, Any] = {
        "description": "bytes of the JSON, where those of tensors follow it",
        "schema": {"type": "string", "pattern": "^[0-9]{1,9}$"},
    }
    octets = {"schema": {"type": "string", "format": "binary"}}
    schema = {"$ref": REFERENCES.format(model=InferenceRequest.__name__)}
    operation["parameters"].append({"name": HEADER_LENGTH, "in": "header", "required": False} | length)
    operation["requestBody"] = {
        "required": True,
        "content": {"application/json": {"schema": schema, "example": EXAMPLE}, "application/octet-stream": octets},
    }
    good = operation["responses"]["200"]
    good["headers"] = {HEADER_LENGTH: length}
    good["content"]["application/octet-stream"] = octets
    return operation
