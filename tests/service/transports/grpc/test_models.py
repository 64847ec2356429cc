"""Models and concepts over gRPC."""

from __future__ import annotations

from typing import Any

import httpx
import pytest
from google.protobuf.json_format import MessageToDict

from service.application import Application
from service.engine.cloud import PointCloud
from service.transports.grpc.generated.shapeconcepts.v1.answer_pb2 import Options
from service.transports.grpc.generated.shapeconcepts.v1.service_pb2 import (
    GetModelRequest,
    ListConceptsRequest,
    ListModelsRequest,
    RespondRequest,
)
from tests.service.transports.grpc.sent import Stub, as_file, refused


def test_models_are_listed_and_told(stub: Stub, client: httpx.Client) -> None:
    (summary,) = stub.ListModels(ListModelsRequest()).models
    assert (summary.name, list(summary.versions), dict(summary.aliases)) == ("tiny", [1], {"production": 1})
    expected = client.get("/v1/models/tiny/versions/1").json()
    for asked in ({}, {"model": "tiny"}, {"model": "tiny@production"}, {"version": 1}, {"alias": "production"}):
        manifest = stub.GetModel(GetModelRequest(**asked)).manifest
        assert (manifest.name, manifest.version, manifest.digest) == ("tiny", 1, expected["digest"])
        assert MessageToDict(manifest.counts) == expected["counts"]
        assert MessageToDict(manifest.params) == expected["params"]


@pytest.mark.parametrize("asked", [{}, {"time": 0.5}, {"time": 0}, {"model": "tiny:1"}, {"alias": "production"}])
def test_concepts_are_those_of_rest_with_their_names(
    stub: Stub, client: httpx.Client, application: Application, asked: dict[str, Any]
) -> None:
    first = client.get("/v1/models/tiny:1/concepts").json()["concepts"][0]["id"]
    application.naming.rename("tiny", 1, first, "mug")
    expected = client.get("/v1/models/tiny:1/concepts", params={k: v for k, v in asked.items() if k == "time"}).json()
    told = MessageToDict(
        stub.ListConcepts(ListConceptsRequest(**asked)).list,
        preserving_proto_field_name=True,
        always_print_fields_with_no_presence=True,
    )
    for concept in told["concepts"]:
        concept.setdefault("name", None)
    assert told == expected
    assert "time" in asked or expected["concepts"][0]["name"] == "mug"


def test_an_answer_can_be_read_by_what_is_told_of_the_concepts(stub: Stub, clouds: list[PointCloud]) -> None:
    for time_ in (None, 0.5):
        answer = stub.Respond(RespondRequest(cloud=as_file(clouds[0]), options=Options(time=time_))).answer
        told = stub.ListConcepts(ListConceptsRequest(time=time_)).list
        assert len(told.concepts) == len(answer.responses)
        sizes = {concept.id: (concept.prototypes, concept.time) for concept in told.concepts}
        responses = dict(zip((concept.id for concept in told.concepts), answer.responses, strict=True))
        for concept in answer.concepts:
            assert sizes[concept.id] == (concept.prototypes, concept.time)
            assert responses[concept.id] == concept.response


@pytest.mark.parametrize(
    ("asked", "code"),
    [
        ({"model": "nobody"}, "NOT_FOUND"),
        ({"version": 9}, "NOT_FOUND"),
        ({"time": 1.5}, "INVALID_ARGUMENT"),
        ({"time": float("nan")}, "INVALID_ARGUMENT"),
        ({"model": "../x"}, "INVALID_ARGUMENT"),
        ({"model": "x" * 1000}, "INVALID_ARGUMENT"),
    ],
)
def test_concepts_of_what_is_not_there_are_refused(stub: Stub, asked: dict[str, Any], code: str) -> None:
    error, _ = refused(lambda: stub.ListConcepts(ListConceptsRequest(**asked)))
    assert error.code().name == code
