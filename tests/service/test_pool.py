"""The pool takes so much work and no more, and says so at once."""

from __future__ import annotations

import asyncio
import threading
import time

import pytest

from service.engine.errors import Overloaded
from service.pool import Pool


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
