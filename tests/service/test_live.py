"""What those who watch streams are given, and what they are not."""

from __future__ import annotations

import asyncio
import threading

import pytest

from service.engine.errors import Overloaded, StreamNotFound, StreamsUnavailable
from service.live import KEYS, WATCHERS, Live, Shown, shown
from service.streams import Stream, latency_of

ROBOTS, ARMS = Stream(key="robots/*/cloud"), Stream(key="arms/*/cloud")


def of(stream: Stream, key: str, number: int = 0) -> Shown:
    return shown(stream, key, {"number": number}, problem=False, cloud=None)


def live() -> Live:
    return Live([ROBOTS, ARMS])


async def numbers(live: Live, stream: str | None, *all_shown: Shown) -> list[tuple[str, int, int]]:
    """Key, number and skipped of what a watcher takes at once after all that was shown."""
    with live.answering(), live.watching(stream) as watcher:
        for one in all_shown:
            live.show(one)
        return [(seen.shown.key, seen.shown.document["number"], seen.skipped) for seen in await watcher.take(5)]


def test_a_slow_watcher_is_given_the_newest_of_each_key_and_told_what_it_missed() -> None:
    every = [of(ROBOTS, f"robots/{robot}/cloud", number) for number in range(5) for robot in (1, 2)]
    taken = asyncio.run(numbers(live(), None, *every, of(ARMS, "arms/1/cloud")))
    assert taken == [("robots/1/cloud", 4, 4), ("robots/2/cloud", 4, 4), ("arms/1/cloud", 0, 0)]


def test_who_watches_one_stream_is_given_nothing_of_others() -> None:
    every = [of(ARMS, "arms/1/cloud"), of(ROBOTS, "robots/1/cloud"), of(ARMS, "arms/1/cloud")]
    assert asyncio.run(numbers(live(), ROBOTS.key, *every)) == [("robots/1/cloud", 0, 0)]


def test_no_more_keys_wait_than_there_is_room_for() -> None:
    taken = asyncio.run(numbers(live(), None, *(of(ROBOTS, f"robots/{n}/cloud", n) for n in range(KEYS + 10))))
    assert [number for _, number, _ in taken] == list(range(10, KEYS + 10))


def test_clouds_are_shown_from_other_threads_and_a_patient_watcher_is_woken() -> None:
    watched = live()

    async def watch() -> int:
        with watched.answering(), watched.watching() as watcher:
            threading.Timer(0.1, watched.show, [of(ROBOTS, "robots/1/cloud", 8)]).start()
            (seen,) = await watcher.take(10)
            return int(seen.shown.document["number"])

    assert asyncio.run(watch()) == 8


def test_a_stream_is_watched_only_while_somebody_looks_at_it() -> None:
    watched = live()

    async def watch() -> None:
        with watched.answering():
            assert not watched.watched(ROBOTS)
            with watched.watching(ROBOTS.key):
                assert (watched.watched(ROBOTS), watched.watched(ARMS)) == (True, False)
                with watched.watching():
                    assert watched.watched(ARMS)
            assert not watched.watched(ROBOTS)

    asyncio.run(watch())


def test_who_cannot_watch_is_told_why() -> None:
    async def watch(watched: Live, stream: str | None) -> None:
        with watched.watching(stream):
            pass

    with pytest.raises(StreamNotFound, match="SHAPE_CONCEPTS_STREAMS"):
        asyncio.run(watch(Live([]), None))
    with pytest.raises(StreamNotFound, match=r"no stream 'legs'; there are robots/\*/cloud, arms/\*/cloud"):
        asyncio.run(watch(live(), "legs"))
    with pytest.raises(StreamsUnavailable, match="has not reached zenoh"):
        asyncio.run(watch(live(), None))


def test_only_so_many_watch_at_a_time_and_those_who_left_make_room() -> None:
    watched = live()

    async def watch(left: int) -> None:
        with watched.watching():
            if left:
                await watch(left - 1)

    with watched.answering():
        with pytest.raises(Overloaded, match=f"{WATCHERS} clients"):
            asyncio.run(watch(WATCHERS))
        asyncio.run(watch(WATCHERS - 1))


@pytest.mark.parametrize(
    ("sent", "latency"),
    [(10**18, 0.03), (10**18 + 10**9, None), (10**17, None), (None, None), ("now", None), (-(10**400), None)],
)
def test_a_latency_is_told_where_the_clocks_agree(sent: object, latency: float | None) -> None:
    assert latency_of(sent, 10**18 + 30_000_000) == latency
