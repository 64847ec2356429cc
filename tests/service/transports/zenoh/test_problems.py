"""Problem documents as zenoh carries them."""

from __future__ import annotations

import logging
import re

import pytest

from service.engine.errors import ContentTooLarge, Overloaded, StoreUnavailable, TooFewPoints
from service.transports.errors import problem_of as of_the_table
from service.transports.zenoh.problems import check_size, problem_of

ID = "0f7f1c3a-6a35-4d9c-8d5e-0d9a1f2b3c4d"
HERE = "robots/7/cloud"


def test_they_are_those_of_the_one_table() -> None:
    document = problem_of(TooFewPoints("There are 3."), HERE, ID)
    occurrence = document["instance"].removeprefix("urn:uuid:")
    assert document == of_the_table(TooFewPoints("There are 3."), occurrence)
    assert re.fullmatch(r"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}", occurrence)


def test_where_trying_again_may_help_they_say_when() -> None:
    assert problem_of(Overloaded(), HERE, ID)["retry_after"] >= 1
    assert problem_of(StoreUnavailable(), HERE, ID)["retry_after"] >= 1
    assert "retry_after" not in problem_of(TooFewPoints(), HERE, ID)


def test_our_faults_are_logged_whole_and_told_plainly(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO):
        documents = [problem_of(error, HERE, ID) for error in (KeyError("secret"), StoreUnavailable("s3://secret"))]
    for document in documents:
        assert "secret" not in str(document)
        assert document["instance"].removeprefix("urn:uuid:") in caplog.text
    assert caplog.text.count("secret") >= 2
    caplog.clear()
    problem_of(TooFewPoints(), HERE, ID)
    assert not caplog.records


def test_a_payload_beyond_the_limit_is_told_its_size() -> None:
    check_size(10, 10)
    with pytest.raises(ContentTooLarge) as caught:
        check_size(11, 10)
    document = problem_of(caught.value, HERE, ID)
    assert (document["status"], "11 bytes" in document["detail"]) == (413, True)
