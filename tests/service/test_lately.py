"""Neither a slow store nor one that is away holds up what could be answered from memory."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest

from service.engine.errors import ModelDamaged, ModelNotFound, StoreUnavailable
from service.engine.model import ShapeModel
from service.lately import Answers, Models
from tests.service.transports.zenoh.waiting import until


def test_a_model_that_is_loading_holds_up_those_who_want_it_and_no_others(model: ShapeModel) -> None:
    go_on, loads = threading.Event(), []

    def load(name: str, version: int) -> ShapeModel:
        loads.append(name)
        if name == "slow":
            assert go_on.wait(10)
        return model

    models = Models(load, 4)
    models.get("quick", 1)
    with ThreadPoolExecutor(4) as threads:
        waiting = [threads.submit(models.get, "slow", 1) for _ in range(3)]
        time.sleep(0.05)
        assert models.get("quick", 1) is model
        assert models.get("other", 1) is model
        assert not any(future.done() for future in waiting)
        go_on.set()
        assert all(future.result() is model for future in waiting)
    assert sorted(loads) == ["other", "quick", "slow"]


def test_a_model_that_cannot_be_loaded_is_refused_and_takes_nobodys_place(model: ShapeModel) -> None:
    loads = []

    def load(name: str, version: int) -> ShapeModel:
        loads.append(name)
        if name == "damaged":
            raise ModelDamaged("cut off")
        return model

    models = Models(load, 1)
    models.get("whole", 1)
    for _ in range(2):
        with pytest.raises(ModelDamaged):
            models.get("damaged", 1)
    models.get("whole", 1)
    assert loads == ["whole", "damaged", "damaged"]


class Clock:
    """A clock that moves when it is told to."""

    def __init__(self) -> None:
        self.shows = 100.0

    def __call__(self) -> float:
        return self.shows


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def answers(clock: Clock) -> Iterator[Answers]:
    answers = Answers(believed=0.2, patience=10, now=clock)
    yield answers
    answers.close()


def away() -> int:
    raise StoreUnavailable("no route to host")


def test_an_answer_is_believed_for_a_moment(answers: Answers, clock: Clock) -> None:
    reads = iter(range(10))
    assert [answers.get("x", lambda: next(reads)) for _ in range(5)] == [0] * 5
    assert answers.get("y", lambda: next(reads)) == 1
    clock.shows += 0.25
    assert answers.get("x", lambda: next(reads)) == 2


def test_what_was_known_holds_while_the_store_is_away(
    answers: Answers, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    with pytest.raises(StoreUnavailable):
        answers.get("x", away)
    assert answers.get("x", lambda: 1) == 1
    clock.shows += 0.25
    with caplog.at_level(logging.WARNING):
        assert [answers.get("x", away) for _ in range(5)] == [1] * 5
    (warning,) = caplog.records
    assert "no route to host" in warning.message
    clock.shows += 0.25
    assert answers.get("x", lambda: 2) == 2


def test_a_store_that_hangs_holds_nobody_up_for_long(clock: Clock) -> None:
    answers, go_on = Answers(believed=0.2, patience=0.2, now=clock), threading.Event()

    def hanging() -> int:
        assert go_on.wait(10)
        return 2

    assert answers.get("x", lambda: 1) == 1
    clock.shows += 0.25
    began = time.monotonic()
    assert [answers.get("x", hanging) for _ in range(100)] == [1] * 100
    clock.shows += 0.25
    assert [answers.get("x", hanging) for _ in range(100)] == [1] * 100
    assert time.monotonic() - began < 1
    go_on.set()
    until(lambda: answers.get("x", hanging) == 2, "what the store says at last is told")
    answers.close()


def test_what_is_there_no_more_is_not_answered_from_memory(answers: Answers, clock: Clock) -> None:
    def gone() -> int:
        raise ModelNotFound("gone")

    answers.get("x", lambda: 1)
    clock.shows += 0.25
    with pytest.raises(ModelNotFound):
        answers.get("x", gone)
    with pytest.raises(StoreUnavailable):
        answers.get("x", away)


def test_what_was_read_before_all_was_forgotten_is_not_believed(answers: Answers) -> None:
    def read_and_forget() -> int:
        answers.forget()
        return 1

    assert answers.get("x", read_and_forget) == 1
    assert answers.get("x", lambda: 2) == 2
    answers.forget()
    assert answers.get("x", lambda: 3) == 3
