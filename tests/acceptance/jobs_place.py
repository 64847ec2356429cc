"""A store and a queue of jobs of their own, and the real processes that use them."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from service.job import Job
from service.jobs import Jobs
from service.store import ModelStore

PATIENCE = 180.0  # seconds that anything may take


class Place:
    """A store and a queue.

    Args:
        folder: where both are, and the logs of processes.
        **given: settings that differ.
    """

    def __init__(self, folder: Path, **given: object) -> None:
        self.folder = folder
        settings: dict[str, object] = {
            "STORE": folder / "store",
            "JOBS_URL": f"sqlite:///{folder / 'queue' / 'jobs.sqlite'}",
            "WORKER_LEASE": 3,
        }
        settings |= {name.upper(): value for name, value in given.items()}
        plain = {name: value for name, value in os.environ.items() if not name.startswith("SHAPE_CONCEPTS_")}
        self.environment = plain | {f"SHAPE_CONCEPTS_{name}": str(value) for name, value in settings.items()}
        self.store = ModelStore(str(settings["STORE"]))
        self.queue = Jobs(str(settings["JOBS_URL"]))

    def ask(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "service.cli", "jobs", *arguments]
        return subprocess.run(command, env=self.environment, capture_output=True, text=True, timeout=PATIENCE)

    def jobs(self, *arguments: str) -> dict[str, Any]:
        asked = self.ask(*arguments, "--json")
        assert asked.returncode == 0, asked.stderr
        answer: dict[str, Any] = json.loads(asked.stdout)
        return answer

    def submit(self, job: str, *arguments: str) -> dict[str, Any]:
        """A job; one that trains on six objects unless the arguments say otherwise."""
        given = arguments or ("--simulate", "6", "--name", "toys")
        return self.jobs("submit", *given, "--renderer", "raycast", "--id", job)

    def until(self, job: str, state: str) -> Job:
        """The job once it is in a state."""

        def reached() -> bool:
            found = self.queue.show(job)
            assert found.state == state or not found.over, found
            return found.state == state

        wait_until(reached, f"job {job} to be {state}")
        return self.queue.show(job)

    def told(self, job: str) -> list[str]:
        """The lines of a job's log."""
        return [line.line for line in self.queue.look(job).lines]

    @contextmanager
    def worker(self, log: str, name: str = "tested", processes: int = 1) -> Iterator[Worker]:
        """A worker process; what is left of it and of its helpers in the end is killed."""
        file = self.folder / f"{log}.log"
        command = [sys.executable, "-m", "worker.cli", "run", "--worker", name, "--workers", str(processes)]
        with file.open("w") as stderr:
            process = subprocess.Popen(command, env=self.environment, stderr=stderr, start_new_session=True)
        try:
            yield Worker(name, process, file)
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()

    @contextmanager
    def api(self, port: int) -> Iterator[subprocess.Popen[bytes]]:
        """A process of the service; killed in the end if it is there still."""
        environment = self.environment | {"SHAPE_CONCEPTS_PORT": str(port), "SHAPE_CONCEPTS_GRPC_PORT": "-1"}
        with (self.folder / "api.log").open("a") as stderr:
            process = subprocess.Popen([sys.executable, "-m", "service.main"], env=environment, stderr=stderr)
        try:
            wait_until(lambda: _answers(port), "the service to answer")
            yield process
        finally:
            process.kill()
            process.wait()


class Worker:
    """A worker process and what it logs."""

    def __init__(self, name: str, process: subprocess.Popen[bytes], file: Path) -> None:
        self.name, self.process, self.file = name, process, file

    @property
    def log(self) -> str:
        return self.file.read_text()

    def said(self, job: str) -> list[str]:
        """Its lines about a job."""
        start = f"job {job}: "
        return [line.partition(start)[2] for line in self.log.splitlines() if start in line]

    def wait_for(self, *lines: str) -> None:
        """Waits for one of several lines."""

        def there() -> bool:
            found = any(line in self.log for line in lines)
            assert found or self.process.poll() is None, f"the worker ended:\n{self.log}"
            return found

        wait_until(there, f"{lines} in {self.file.name}:\n{self.log}")

    def signal(self, number: signal.Signals) -> None:
        self.process.send_signal(number)

    def end(self, number: signal.Signals) -> int:
        self.signal(number)
        return self.process.wait(PATIENCE)


def free_port() -> int:
    """A TCP port of the loopback address that nobody listens on."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port: int = free.getsockname()[1]
        return port


def _answers(port: int) -> bool:
    with suppress(OSError), socket.create_connection(("127.0.0.1", port), timeout=1):
        return True
    return False


def wait_until(happened: Callable[[], bool], what: str) -> None:
    """Waits until something happened."""
    until = time.monotonic() + PATIENCE
    while not happened():
        assert time.monotonic() < until, f"waited in vain for {what}"
        time.sleep(0.02)
