"""Requests and answers are measured the same whatever transport they came by."""

from __future__ import annotations

import asyncio
import logging
import threading

import pytest
from prometheus_client.parser import text_string_to_metric_families

from service.application import Application
from service.engine.cloud import PointCloud
from service.engine.errors import Cancelled, TooFewPoints
from service.telemetry import Seen, Telemetry, current
from tests.service.measured import samples


def test_a_request_is_counted_by_wire_operation_and_outcome() -> None:
    telemetry = Telemetry()
    for wire in ("grpc", "zenoh"):
        with telemetry.request(wire, "1", "Respond"):
            assert samples(telemetry)["shape_concepts_requests_under_way", ("wire", wire)] == 1
    with pytest.raises(TooFewPoints), telemetry.request("grpc", "2", "Respond"):
        raise TooFewPoints("3 points")
    with telemetry.request("grpc", "3", "Respond") as seen:
        seen.failed(Cancelled("the client left"))
        seen.failed("late")  # what failed first is the reason
    found = samples(telemetry)

    def count(wire: str, outcome: str) -> float:
        return found["shape_concepts_requests_total", ("operation", "Respond"), ("outcome", outcome), ("wire", wire)]

    assert (count("grpc", "ok"), count("zenoh", "ok")) == (1, 1)
    assert (count("grpc", "too-few-points"), count("grpc", "cancelled")) == (1, 1)
    assert found["shape_concepts_request_seconds_count", ("operation", "Respond"), ("wire", "grpc")] == 3
    assert found["shape_concepts_requests_under_way", ("wire", "grpc")] == 0


@pytest.mark.parametrize(
    ("error", "outcome"),
    [(RuntimeError("the secret inside"), "internal"), (asyncio.CancelledError(), "cancelled")],
)
def test_what_nobody_foresaw_is_an_outcome_without_its_message(error: BaseException, outcome: str) -> None:
    telemetry = Telemetry()
    with pytest.raises(type(error)), telemetry.request("rest", "1") as seen:
        raise error
    assert seen.outcome == outcome
    assert "secret" not in telemetry.metrics.page()[0].decode()


def test_the_stages_of_an_answer_are_told_by_wire(application: Application, clouds: list[PointCloud]) -> None:
    telemetry = application.telemetry
    with telemetry.request("zenoh", "1", "respond") as seen:
        answer = asyncio.run(application.pool.run(application.respond, clouds[0]))
    assert seen.model == ("tiny", 1)
    assert application.respond(clouds[0]).timings_ms.keys() == answer.timings_ms.keys()
    found = samples(telemetry)
    for stage, spent in answer.timings_ms.items():
        for wire in ("zenoh", "local"):
            assert found["shape_concepts_stage_seconds_count", ("stage", stage), ("wire", wire)] == 1
        measured = found["shape_concepts_stage_seconds_sum", ("stage", stage), ("wire", "zenoh")]
        assert measured == pytest.approx(spent / 1000, abs=1e-6)
    assert found["shape_concepts_novelty_count",] == 2
    assert found["shape_concepts_novelty_sum",] == pytest.approx(2 * answer.novelty)
    assert found["shape_concepts_wait_seconds_count",] == 1


def test_requests_at_the_same_time_are_kept_apart(application: Application) -> None:
    both = threading.Barrier(2)

    def work() -> Seen | None:
        both.wait(10)
        return current()

    async def ask(request_id: str) -> bool:
        with application.telemetry.request("rest", request_id) as seen:
            return await application.pool.run(work) is seen

    async def ask_twice() -> list[bool]:
        return await asyncio.gather(ask("1"), ask("2"))

    assert asyncio.run(ask_twice()) == [True, True]
    assert current() is None


def test_it_is_told_how_the_service_stands(application: Application, clouds: list[PointCloud]) -> None:
    application.respond(clouds[0])
    pool, intake = application.pool, application.intake
    go_on, begun = threading.Event(), threading.Barrier(3)

    def work() -> None:
        begun.wait(10)
        go_on.wait(10)

    async def look() -> dict[tuple[object, ...], float]:
        with intake.opened() as take, pool.admitted(), pool.admitted(), pool.admitted():
            take(1000)
            running = [asyncio.create_task(pool.run(work)) for _ in range(2)]
            waiting = asyncio.create_task(pool.run(int))
            await asyncio.to_thread(begun.wait, 10)
            found = samples(application.telemetry)
            go_on.set()
            await asyncio.gather(*running, waiting)
        return found

    found = asyncio.run(look())
    assert (found["shape_concepts_queue_at_work",], found["shape_concepts_queue_waiting",]) == (2, 1)
    assert found["shape_concepts_queue_places",] == application.settings.workers + application.settings.queue
    assert found["shape_concepts_intake_bytes",] == 1000
    assert found["shape_concepts_intake_limit_bytes",] == application.settings.max_bodies
    assert found["shape_concepts_model_loaded", ("model", "tiny"), ("version", "1")] == 1
    idle = samples(application.telemetry)
    assert [idle[f"shape_concepts_{name}",] for name in ("queue_at_work", "queue_waiting", "intake_bytes")] == [0, 0, 0]


def test_an_alias_that_moves_is_seen_though_nobody_asks(application: Application, clouds: list[PointCloud]) -> None:
    application.respond(clouds[0])
    serving = ("shape_concepts_model_version", ("alias", "production"), ("model", "tiny"))
    assert samples(application.telemetry)[serving] == 1
    model, manifest = application.store.load("tiny", 1)
    application.store.publish(model, name="tiny", seed=manifest.seed, source={})
    for _ in range(40):
        if samples(application.telemetry)[serving] == 2:
            break
        threading.Event().wait(0.1)
    assert samples(application.telemetry)[serving] == 2


def test_dropped_clouds_are_counted() -> None:
    telemetry = Telemetry()
    telemetry.dropped("zenoh")
    telemetry.dropped("zenoh", 3)
    assert samples(telemetry)["shape_concepts_dropped_total", ("wire", "zenoh")] == 4


def test_a_request_ends_with_one_line_in_the_log(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, "service.telemetry"), Telemetry().request("grpc", "id-7", "Respond"):
        pass
    (line,) = caplog.messages
    assert line.startswith("id-7 grpc Respond for -: ok in ")


def test_services_in_one_process_do_not_share_their_metrics() -> None:
    first, second = Telemetry(), Telemetry()
    first.dropped("zenoh")
    assert ("shape_concepts_dropped_total", ("wire", "zenoh")) not in samples(second)


def test_every_metric_is_described() -> None:
    for family in text_string_to_metric_families(Telemetry().metrics.page()[0].decode()):
        assert family.documentation, family.name
