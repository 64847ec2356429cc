"""The one table of error codes knows every error."""

from __future__ import annotations

from http import HTTPStatus

import pytest

from service.engine import errors as engine_errors
from service.engine.errors import RateExceeded, ShapeConceptsError, StoreUnavailable, TooFewPoints
from service.transports.errors import INTERNAL, TABLE, problem_of, status_of

GRPC = {"CANCELLED", "DATA_LOSS", "FAILED_PRECONDITION", "INTERNAL", "INVALID_ARGUMENT", "NOT_FOUND"}
GRPC |= {"RESOURCE_EXHAUSTED", "UNAVAILABLE", "UNAUTHENTICATED", "PERMISSION_DENIED", "ALREADY_EXISTS", "ABORTED"}
ERRORS = [
    error
    for error in vars(engine_errors).values()
    if isinstance(error, type) and issubclass(error, ShapeConceptsError) and error is not ShapeConceptsError
]


@pytest.mark.parametrize("error", ERRORS)
def test_every_error_has_a_status_on_every_wire(error: type[ShapeConceptsError]) -> None:
    status = status_of(error("..."))
    assert status is not INTERNAL
    assert 400 <= status.http < 600
    assert status.grpc in GRPC
    assert status.title


def test_http_and_grpc_agree_on_whose_fault_it_is() -> None:
    server = {"INTERNAL", "UNAVAILABLE", "DATA_LOSS", "FAILED_PRECONDITION"}
    for status in TABLE.values():
        if status.http >= 500:
            assert status.grpc in server
        if status.http == HTTPStatus.NOT_FOUND:
            assert status.grpc == "NOT_FOUND"


def test_a_problem_document_names_the_error_and_the_occurrence() -> None:
    document = problem_of(TooFewPoints("The cloud has 3 points."), "some-id")
    assert document == {
        "type": "urn:shape-concepts:error:too-few-points",
        "title": "The cloud cannot be answered",
        "status": 422,
        "detail": "The cloud has 3 points.",
        "instance": "urn:shape-concepts:request:some-id",
    }


def test_an_error_without_a_message_is_explained_by_its_class() -> None:
    assert problem_of(TooFewPoints(), "x")["detail"] == TooFewPoints.__doc__


def test_an_error_that_knows_when_to_try_again_says_so() -> None:
    assert [status_of(RateExceeded("hasty", after)).retry for after in (0, 0.2, 1, 11.2)] == [1, 1, 1, 12]
    assert status_of(TooFewPoints()).retry == 0


def test_where_the_store_is_stays_with_the_operator() -> None:
    assert "bucket" not in problem_of(StoreUnavailable("s3://bucket cannot be read"), "x")["detail"]
