"""Many clients at once, in a process of their own: python -m tests.benchmarks.load, told what to do by a line of JSON.

Without a rate, each client asks again as soon as it has its answer. With one, requests are due at regular times,
whatever became of those before; a request's time counts from when it was due, so that a service which is late cannot
hide it.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tests.benchmarks.askers import WIRES, Asker, Place
from tests.conftest import ROOT

SWITCH = 0.0005  # seconds that a client keeps the interpreter from others


class Told(NamedTuple):
    """What was seen of a load.

    Attributes:
        answered: seconds that each answer took.
        refused: seconds that each refusal took.
        late: requests that were begun more than `LATE` after they were due, as all clients were waiting: a share.
        seconds: that the load lasted.
        worked: processor time of all clients, seconds.
    """

    answered: list[float]
    refused: list[float]
    late: float
    seconds: float
    worked: float


LATE = 0.005  # seconds


class Load:
    """Clients in threads of this process."""

    def __init__(self, askers: list[Asker], seconds: float, rate: float, settling: float) -> None:
        self._askers, self._rate = askers, rate
        self._begun = time.perf_counter()
        self._counted = self._begun + settling
        self._end = self._counted + seconds
        self._next = 0
        self._lock = threading.Lock()
        self.late = 0
        self.taken: dict[bool, list[float]] = {True: [], False: []}

    def run(self) -> Told:
        """Lets all clients ask until the time is over."""
        threads = [threading.Thread(target=self._client, args=[asker], daemon=True) for asker in self._askers]
        for thread in threads:
            thread.start()
        time.sleep(max(0.0, self._counted - time.perf_counter()))
        before = _worked()
        time.sleep(max(0.0, self._end - time.perf_counter()))
        worked = _worked() - before
        for thread in threads:
            thread.join(30)
        seen = len(self.taken[True]) + len(self.taken[False])
        return Told(self.taken[True], self.taken[False], self.late / max(seen, 1), self._end - self._counted, worked)

    def _client(self, asker: Asker) -> None:
        while (due := self._due()) < self._end:
            if (left := due - time.perf_counter()) > 0:
                time.sleep(left)
            late = time.perf_counter() - due > LATE
            answered = asker.ask()
            now = time.perf_counter()
            if self._counted <= due and now < self._end + 1:
                with self._lock:
                    self.taken[answered].append(now - due)
                    self.late += late

    def _due(self) -> float:
        """When the next request is due."""
        if not self._rate:
            return time.perf_counter()
        with self._lock:
            self._next += 1
            return self._begun + (self._next - 1) / self._rate


def _worked() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def put_under_load(
    wire: str, places: list[Place], folder: Path, clients: int, seconds: float, rate: float = 0.0, settling: float = 1.0
) -> Told:
    """What a load in a process of its own sees.

    Args:
        wire: a name of `WIRES`.
        places: the replicas; clients are shared out among them.
        folder: with the cloud as cloud.npy, cloud.ply, ...
        clients: how many.
        seconds: that are counted.
        rate: requests a second of all clients together; 0: each asks without a pause.
        settling: seconds before those, which are not counted.
    """
    asked = [wire, places, str(folder), clients, seconds, rate, settling]
    command = [sys.executable, "-m", "tests.benchmarks.load", json.dumps(asked)]
    done = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE)
    return Told(*json.loads(done.stdout))


def files_in(folder: Path) -> dict[str, bytes]:
    """The cloud's files, by format."""
    return {file.suffix[1:]: file.read_bytes() for file in folder.glob("cloud.*")}


def main() -> None:
    """Does what the line says, and tells what was seen in JSON."""
    wire, places, folder, clients, seconds, rate, settling = json.loads(sys.argv[1])
    sys.setswitchinterval(SWITCH)
    files = files_in(Path(folder))
    askers = [WIRES[wire](Place(*places[number % len(places)]), files) for number in range(clients)]
    for asker in askers:
        asker.ask()
    print(json.dumps(Load(askers, seconds, rate, settling).run()))


if __name__ == "__main__":
    main()


def quantile(taken: list[float], share: float) -> float:
    """A quantile of times, milliseconds; NaN of none."""
    return 1e3 * float(np.quantile(taken, share)) if taken else float("nan")
