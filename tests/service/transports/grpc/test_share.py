"""The clouds of one call wait for one another, and are refused only where none of them has a place."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator

import pytest

from service.engine.errors import Overloaded
from service.pool import Pool
from service.transports.grpc.share import Share


@pytest.fixture
def pool() -> Iterator[Pool]:
    pool = Pool(workers=2, queue=0)
    yield pool
    pool.close()


async def most_at_once(share: Share, clouds: int) -> int:
    """How many of a call's clouds have a place at the same time."""
    now = most = 0

    async def work() -> None:
        nonlocal now, most
        async with share.place():
            now += 1
            most = max(most, now)
            await asyncio.sleep(0.001)
            now -= 1

    await asyncio.gather(*(work() for _ in range(clouds)))
    return most


def test_a_call_has_as_many_places_as_there_are(pool: Pool) -> None:
    assert asyncio.run(most_at_once(Share(pool), 20)) == 2


def test_a_call_goes_on_with_the_one_place_that_it_keeps(pool: Pool) -> None:
    async def run() -> None:
        with pool.admitted(), pool.admitted():
            assert await most_at_once(Share(pool, kept=1), 20) == 1

    asyncio.run(run())


def test_a_call_without_a_place_is_refused(pool: Pool) -> None:
    async def run() -> None:
        with pool.admitted(), pool.admitted(), pytest.raises(Overloaded):
            await most_at_once(Share(pool), 1)

    asyncio.run(run())


def test_all_places_are_given_back_whatever_happens(pool: Pool) -> None:
    async def run() -> None:
        share = Share(pool)
        async with share.place():
            waiting = [asyncio.ensure_future(most_at_once(share, 3)) for _ in range(3)]
            await asyncio.sleep(0.0005)
            for task in waiting:
                task.cancel()
            await asyncio.gather(*waiting, return_exceptions=True)
        with pool.admitted(), pool.admitted(), pytest.raises(Overloaded), pool.admitted():
            pass
        assert await most_at_once(share, 5) == 2

    asyncio.run(run())
