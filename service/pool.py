"""The bounded pool on which clouds are answered, and the limits on what may wait for it."""

from __future__ import annotations

import asyncio
import threading
import time as clock
from collections import deque
from collections.abc import Awaitable, Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import copy_context
from typing import Any, Generic, NamedTuple, ParamSpec, TypeVar

from service.engine.errors import Cancelled, Overloaded

P = ParamSpec("P")
S = TypeVar("S")
T = TypeVar("T")


BURST = 0.1  # seconds for which some may wait all the time before it is taken for more than a burst
STANDING = 3  # requests a worker that may wait then


class Intake:
    """The limit on the bytes of all requests together: while they arrive, wait for the pool, and are worked on.

    Only bytes that have arrived count, so a request that stands open without sending anything takes nothing away.

    Args:
        limit: bytes.
    """

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self._held = 0
        self._lock = threading.Lock()

    @property
    def held(self) -> int:
        """Bytes of all requests now."""
        return self._held

    @contextmanager
    def opened(self) -> Iterator[Callable[[int], None]]:
        """Yields what is to be told the number of bytes that arrive; at the end they are free again.

        Raises:
            Overloaded: by what is told, when these bytes are too many; at once, without waiting.
        """
        mine = 0

        def take(count: int) -> None:
            nonlocal mine
            with self._lock:
                if self._held + count > self.limit:
                    raise Overloaded(
                        f"The requests at work and waiting fill the {self.limit} bytes that they may; try again in a "
                        "second."
                    )
                self._held += count
                mine += count

        try:
            yield take
        finally:
            with self._lock:
                self._held -= mine


class Work(NamedTuple, Generic[T]):
    """Work that was given to a pool.

    Attributes:
        result: for whoever gave it; may be cancelled without an effect on the work.
        thread: ends when the thread is free again; cancelled, the work is dropped unless it has begun.
    """

    result: asyncio.Future[T]
    thread: Future[None]

    async def end(self) -> None:
        """Drops the work, or waits for the thread that is at it."""
        if not self.thread.cancel():
            await asyncio.wait([asyncio.wrap_future(self.thread)])


class Pool:
    """Threads for work on the CPU, away from the event loop.

    Whoever wants work done first asks to be admitted, once all that the work needs is there: a client who is slow to
    send its cloud keeps no other from its answer.

    A queue is there to take in bursts. Where some have waited all the time for longer than a burst takes, there is too
    much to do, and a long queue would only have everybody wait: then few may wait, until nobody does. (The controlled
    delay of Nichols and Jacobson, "Controlling queue delay", 2012, at the entrance.)

    Args:
        workers: threads.
        queue: how many more than those may be admitted.
        waited: is told how long each piece of work waited for a thread, seconds.
        now: a clock, seconds.
    """

    def __init__(
        self,
        workers: int,
        queue: int,
        waited: Callable[[float], None] = lambda seconds: None,
        now: Callable[[], float] = clock.monotonic,
    ) -> None:
        self.places = workers + queue
        self._waited = waited
        self._working = 0
        self._workers = workers
        self._admitted = 0
        self._now = now
        self._nobody_waited = now()
        self._lock = threading.Lock()
        self._threads = ThreadPoolExecutor(workers, thread_name_prefix="respond")

    @property
    def at_work(self) -> int:
        """Pieces of work that threads are at."""
        return self._working

    @property
    def waiting(self) -> int:
        """Those admitted whose work has not begun."""
        return max(0, self._admitted - self._working)

    @contextmanager
    def admitted(self) -> Iterator[None]:
        """A place among those at work and those waiting.

        Raises:
            Overloaded: all places are taken; at once, without waiting.
        """
        if not self._take(self._open()):
            raise self._full()
        try:
            yield
        finally:
            self._give_back()

    def check(self) -> None:
        """Takes no place; refuses who need not even send the rest of a request.

        Raises:
            Overloaded: all places are taken now.
        """
        if self._admitted >= self._open():
            raise self._full()

    def _full(self) -> Overloaded:
        return Overloaded(f"{self._admitted} requests are already at work or waiting; try again in a second.")

    def _open(self) -> int:
        """How many places there are now."""
        if self._admitted <= self._workers or self._now() - self._nobody_waited < BURST:
            return self.places
        return min(self.places, (1 + STANDING) * self._workers)

    def hand_over(self, work: Callable[[], T], tell: Callable[[Any, BaseException | None], object]) -> Future[None]:
        """Has work done on one of the threads, in the caller's context. The caller has been admitted.

        Args:
            work: to do.
            tell: called on that thread with the result, or with what was raised instead; it should not take long.

        Returns:
            What ends when the thread is free again; cancelled, the work is dropped unless it has begun.
        """
        context, came = copy_context(), clock.perf_counter()

        def do() -> None:
            self._waited(clock.perf_counter() - came)
            with self._lock:
                self._working += 1
            result, raised = None, None
            try:
                result = context.run(work)
            except BaseException as error:
                raised = error
            finally:
                with self._lock:
                    self._working -= 1
            tell(result, raised)

        return self._threads.submit(do)

    def begin(self, work: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> Work[T]:
        """Has work done on one of the threads, for an event loop; as `hand_over`."""
        loop = asyncio.get_running_loop()
        future: asyncio.Future[T] = loop.create_future()

        def settle(result: T, raised: BaseException | None) -> None:
            if future.done():
                return
            if raised is None:
                future.set_result(result)
            else:
                future.set_exception(raised)

        def tell(result: T, raised: BaseException | None) -> None:
            loop.call_soon_threadsafe(settle, result, raised)

        thread = self.hand_over(lambda: work(*args, **kwargs), tell)
        thread.add_done_callback(lambda ended: ended.cancelled() and loop.call_soon_threadsafe(future.cancel))
        return Work(future, thread)

    async def run(self, work: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        """The result of work, as `begin` has it done; dropped where the caller is cancelled before it began."""
        begun = self.begin(work, *args, **kwargs)
        try:
            return await begun.result
        except asyncio.CancelledError:
            begun.thread.cancel()
            raise

    async def run_each(
        self, work: Callable[[S], T], items: Sequence[S], abandoned: Callable[[], Awaitable[bool]]
    ) -> list[T]:
        """The results of work done on each of several items, in their order. The caller has been admitted, once.

        One item after another is worked on in the caller's place, and others beside it while threads are idle: as soon
        as somebody else asks for these, they are theirs after the item under way.

        Args:
            work: raises nothing that is foreseen.
            items: of the same caller.
            abandoned: asked before each item whether nobody waits for the results any more.

        Raises:
            Cancelled: they were abandoned; the items under way are finished first.
        """
        results: dict[int, T] = {}
        waiting = deque(enumerate(items))

        async def work_on(place: int, item: S) -> None:
            results[place] = await self.run(work, item)

        async with asyncio.TaskGroup() as beside:
            while waiting and not await abandoned():
                while len(waiting) > 1 and self._take(self._workers):
                    beside.create_task(work_on(*waiting.popleft())).add_done_callback(lambda _: self._give_back())
                await work_on(*waiting.popleft())
        if waiting:
            raise Cancelled(f"The client hung up when {len(results)} of {len(items)} were done.")
        return [results[place] for place in range(len(items))]

    def close(self) -> None:
        """Waits for the work under way and drops what has not begun."""
        self._threads.shutdown(cancel_futures=True)

    def _take(self, limit: int) -> bool:
        """Takes a place unless so many are taken; returns whether it did."""
        with self._lock:
            taken = self._admitted < limit
            if self._admitted <= self._workers:
                self._nobody_waited = self._now()
            self._admitted += taken
            return taken

    def _give_back(self) -> None:
        with self._lock:
            self._admitted -= 1
            if self._admitted <= self._workers:
                self._nobody_waited = self._now()
