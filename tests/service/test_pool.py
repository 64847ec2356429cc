"""The pool takes so much work and no more, and says so at once."""

from __future__ import annotations

import asyncio
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack

import pytest

from service.engine.errors import Cancelled, Overloaded
from service.pool import BURST, STANDING, Intake, Pool
from tests.service.test_lately import Clock


def test_one_too_many_is_refused_at_once_and_admitted_later() -> None:
    pool = Pool(workers=1, queue=1)
    with pool.admitted(), pool.admitted():
        began = time.monotonic()
        with pytest.raises(Overloaded, match="2 requests"), pool.admitted():
            pass
        assert time.monotonic() - began < 0.1
    with pool.admitted():
        pass
    pool.close()


def test_failed_work_gives_its_place_back() -> None:
    pool = Pool(workers=1, queue=0)
    for _ in range(3):
        with pytest.raises(ZeroDivisionError), pool.admitted():
            asyncio.run(pool.run(lambda: 1 // 0))
    with pool.admitted():
        assert asyncio.run(pool.run(lambda: 7)) == 7
    pool.close()


def test_the_event_loop_goes_on_while_work_is_done() -> None:
    pool = Pool(workers=1, queue=0)
    done = threading.Event()

    async def work_and_release() -> bool:
        work = asyncio.create_task(pool.run(done.wait, 5))
        await asyncio.sleep(0.01)
        done.set()
        return await work

    assert asyncio.run(work_and_release())
    pool.close()


def test_an_intake_counts_what_has_arrived_until_its_request_ends() -> None:
    intake = Intake(10)
    with intake.opened() as first, intake.opened() as second, intake.opened():
        first(6)
        with pytest.raises(Overloaded, match="10 bytes"):
            second(5)
        second(4)
        with pytest.raises(Overloaded):
            first(1)
    with intake.opened() as later:
        later(10)


def test_an_intake_of_many_threads_ends_empty() -> None:
    intake = Intake(1000)

    def receive(_: int) -> None:
        with intake.opened() as take:
            for _ in range(100):
                take(1)

    with ThreadPoolExecutor(8) as threads:
        list(threads.map(receive, range(80)))
    with intake.opened() as take:
        take(1000)


async def never() -> bool:
    return False


class TestSeveralItems:
    def test_results_come_in_the_order_of_the_items_and_all_places_are_given_back(self) -> None:
        pool = Pool(workers=3, queue=0)

        def work(item: int) -> int:
            time.sleep(0.001 * (item % 3))
            return item * item

        for count in (0, 1, 2, 50):
            with pool.admitted():
                assert asyncio.run(pool.run_each(work, range(count), never)) == [item * item for item in range(count)]
        with pool.admitted(), pool.admitted(), pool.admitted():
            pass
        pool.close()

    def test_idle_threads_are_used_and_no_more(self) -> None:
        pool = Pool(workers=3, queue=0)
        together = threading.Barrier(3, timeout=5)
        with pool.admitted():
            asyncio.run(pool.run_each(lambda _: together.wait(), range(3), never))
        pool.close()

    def test_another_request_waits_for_one_item_only(self) -> None:
        pool = Pool(workers=1, queue=1)
        done: list[str] = []

        begun, go_on = threading.Event(), threading.Event()

        def work(name: str) -> None:
            begun.set()
            assert go_on.wait(10)
            done.append(name)

        async def both() -> None:
            with pool.admitted():
                batch = asyncio.create_task(pool.run_each(work, [f"item {number}" for number in range(10)], never))
                await asyncio.to_thread(begun.wait, 10)
                with pool.admitted():
                    other = pool.begin(work, "other")
                    go_on.set()
                    await other.result
                await batch

        asyncio.run(both())
        assert done.index("other") <= 2
        pool.close()

    def test_work_that_fails_gives_every_place_back(self) -> None:
        pool = Pool(workers=2, queue=0)
        with pytest.raises(ExceptionGroup), pool.admitted():
            asyncio.run(pool.run_each(lambda item: 1 // (item - 5), range(10), never))
        with pool.admitted(), pool.admitted():
            pass
        pool.close()

    def test_what_nobody_waits_for_any_more_is_left_undone(self) -> None:
        pool = Pool(workers=1, queue=0)
        done: list[int] = []

        async def abandoned() -> bool:
            return len(done) == 3

        with pytest.raises(Cancelled, match="3 of 10"), pool.admitted():
            asyncio.run(pool.run_each(done.append, range(10), abandoned))
        assert done == [0, 1, 2]
        with pool.admitted():
            pass
        pool.close()


class TestTooMuchToDo:
    def test_a_burst_is_taken_in_whole(self) -> None:
        pool = Pool(workers=2, queue=30, now=Clock())
        with ExitStack() as stack:
            for _ in range(32):
                stack.enter_context(pool.admitted())
            with pytest.raises(Overloaded, match="32 requests"):
                pool.check()
        pool.close()

    def test_where_some_have_waited_all_the_time_few_may_wait(self) -> None:
        clock = Clock()
        pool = Pool(workers=2, queue=30, now=clock)
        with ExitStack() as stack:
            held = [stack.enter_context(ExitStack()) for _ in range(12)]
            for place in held:
                place.enter_context(pool.admitted())
            clock.shows += 1.5 * BURST
            few = 2 * (1 + STANDING)
            for place in held:
                left = pool.at_work + pool.waiting
                if left >= few:
                    with pytest.raises(Overloaded), pool.admitted():
                        pass
                else:
                    with pool.admitted():
                        pass
                place.close()
        pool.close()

    def test_when_nobody_waits_any_more_another_burst_is_taken_in(self) -> None:
        clock = Clock()
        pool = Pool(workers=1, queue=30, now=clock)
        with pool.admitted(), pool.admitted():
            clock.shows += 1.5 * BURST
        with ExitStack() as stack:
            for _ in range(31):
                stack.enter_context(pool.admitted())
        pool.close()

    def test_a_queue_shorter_than_that_stays_as_short(self) -> None:
        clock = Clock()
        pool = Pool(workers=1, queue=1, now=clock)
        with pool.admitted(), pool.admitted():
            clock.shows += 1.5 * BURST
            with pytest.raises(Overloaded):
                pool.check()
        pool.close()


def test_work_dropped_when_the_pool_closes_is_waited_for_no_longer() -> None:
    pool = Pool(workers=1, queue=1)
    begun, go = threading.Event(), threading.Event()

    def hold() -> None:
        begun.set()
        go.wait(5)

    async def close_meanwhile() -> None:
        first, second = pool.begin(hold), pool.begin(hold)
        await asyncio.to_thread(begun.wait, 5)
        closing = asyncio.create_task(asyncio.to_thread(pool.close))
        with pytest.raises(asyncio.CancelledError):
            await second.result
        go.set()
        await first.result
        await closing

    asyncio.run(close_meanwhile())
