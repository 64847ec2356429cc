"""Results come in order, a few pieces are at work at a time, and who does not take results holds up what comes."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import aclosing

import pytest

from service.transports.grpc.flow import in_order


class Source:
    """Counts from 0 and remembers how far it was asked."""

    def __init__(self, count: int, fails: bool = False) -> None:
        self._count, self._fails = count, fails
        self.asked = 0

    async def __aiter__(self) -> AsyncIterator[int]:
        for number in range(self._count):
            self.asked = number + 1
            yield number
        if self._fails:
            raise ValueError("no more")


class Work:
    """Squares numbers, later ones sooner; counts those at work and those done."""

    def __init__(self) -> None:
        self.busy = self.most = self.done = 0

    async def __call__(self, number: int) -> int:
        self.busy += 1
        self.most = max(self.most, self.busy)
        await asyncio.sleep(0.001 * (7 - number % 7))
        self.busy -= 1
        self.done += 1
        return number**2


@pytest.mark.parametrize("at_once", [1, 3, 100])
def test_results_come_in_the_order_of_what_came(at_once: int) -> None:
    async def run() -> None:
        work = Work()
        results = [result async for result in in_order(aiter(Source(30)), work, at_once)]
        assert results == [number**2 for number in range(30)]
        assert work.most == min(at_once, 30)

    asyncio.run(run())


def test_nothing_comes_in_while_results_are_not_taken() -> None:
    async def run() -> None:
        source, work = Source(100), Work()
        async with aclosing(in_order(aiter(source), work, 4)) as results:
            for taken in range(1, 10):
                await anext(results)
                await asyncio.sleep(0.02)
                assert source.asked == taken + 3  # the one that was taken is still being sent
        assert work.done == source.asked

    asyncio.run(run())


def test_what_goes_wrong_is_raised_after_the_results_before_it() -> None:
    async def run() -> None:
        results = in_order(aiter(Source(5, fails=True)), Work(), 2)
        assert [await anext(results) for _ in range(5)] == [0, 1, 4, 9, 16]
        with pytest.raises(ValueError, match="no more"):
            await anext(results)

    asyncio.run(run())


def test_whoever_stops_taking_breaks_off_what_is_at_work() -> None:
    async def run() -> None:
        ended = []

        async def work(number: int) -> int:
            try:
                await asyncio.sleep(60 * number)
            finally:
                ended.append(number)
            return number

        async with aclosing(in_order(aiter(Source(100)), work, 8)) as results:
            await anext(results)
        assert sorted(ended) == list(range(8))

    asyncio.run(run())
