"""Newest wins, and what is dropped is counted."""

from __future__ import annotations

import random
import threading

from service.transports.zenoh.newest import Newest


def test_the_newest_waits_and_those_before_it_are_discarded_and_counted() -> None:
    discarded: list[int] = []
    newest: Newest[int] = Newest(keys=2, workers=1, discard=discarded.append)
    assert newest.put("a", 1)
    assert [newest.put("a", number) for number in (2, 3, 4)] == [False] * 3
    assert newest.take("a") == (4, 3)
    assert discarded == [1, 2, 3]
    newest.drop("a")
    assert not newest.put("a", 5)
    assert newest.take("a") == (5, 1)
    assert newest.take("a") is None
    assert newest.put("a", 6)


def test_keys_do_not_displace_each_other() -> None:
    newest: Newest[int] = Newest(keys=5, workers=1, discard=lambda item: None)
    assert all(newest.put(key, 1) for key in "abcde")
    assert [newest.take(key) for key in "abcde"] == [(1, 0)] * 5


def test_the_key_that_was_idle_longest_is_forgotten_and_those_at_work_are_not() -> None:
    discarded: list[str] = []
    newest: Newest[str] = Newest(keys=2, workers=1, discard=discarded.append)
    assert newest.put("busy", "first")
    assert newest.put("idle", "x")
    assert newest.take("idle") == ("x", 0)
    assert newest.take("idle") is None
    newest.put("idle", "y")  # now both have a worker
    assert not newest.put("third", "z")
    assert discarded == ["z"]
    newest.take("idle"), newest.take("idle")
    assert newest.put("third", "z")
    assert newest.take("busy") == ("first", 0)


def test_a_key_may_have_as_many_workers_as_are_allowed() -> None:
    newest: Newest[int] = Newest(keys=1, workers=2, discard=lambda item: None)
    assert newest.put("a", 1)
    assert newest.take("a") == (1, 0)
    assert newest.put("a", 2)
    assert newest.take("a") == (2, 0)
    assert not newest.put("a", 3)


def test_every_cloud_is_taken_once_or_discarded_once_whatever_the_threads_do() -> None:
    taken: list[int] = []
    discarded: list[int] = []
    told = []
    newest: Newest[int] = Newest(keys=3, workers=2, discard=discarded.append)

    def work(key: str) -> None:
        while (found := newest.take(key)) is not None:
            taken.append(found.item)
            told.append(found.dropped)

    def robot(number: int) -> None:
        draw, workers = random.Random(number), []
        for item in range(2000):
            key = draw.choice("abc")
            if newest.put(key, number * 10_000 + item):
                workers.append(threading.Thread(target=work, args=[key]))
                workers[-1].start()
        for worker in workers:
            worker.join()

    robots = [threading.Thread(target=robot, args=[number]) for number in range(4)]
    for thread in robots:
        thread.start()
    for thread in robots:
        thread.join()
    assert sorted(taken + discarded) == [number * 10_000 + item for number in range(4) for item in range(2000)]
    assert sum(told) == len(discarded)
