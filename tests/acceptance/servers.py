"""The servers that the service stands on, as processes of a test's own on the loopback address."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest

PATIENCE = 60.0  # seconds


def free_ports(count: int) -> list[int]:
    """TCP ports that nobody listens on."""
    taken = [socket.create_server(("127.0.0.1", 0)) for _ in range(count)]
    ports = [each.getsockname()[1] for each in taken]
    for each in taken:
        each.close()
    return ports


class Postgres:
    """A Postgres server with an empty database; a folder that every user may enter holds it.

    Attributes:
        url: of the database.
    """

    def __init__(self, folder: Path, user: str, database: str, password: str) -> None:
        found = sorted(Path("/usr/lib/postgresql").glob("*/bin")) or [Path(shutil.which("initdb") or "").parent]
        if not (found[-1] / "initdb").exists():
            pytest.skip("Postgres is not installed")
        self._programs, self._folder = found[-1], folder
        self._as = ["runuser", "-u", "postgres", "--"] if os.getuid() == 0 else []  # it refuses to run as root
        if self._as:
            shutil.chown(folder, "postgres")
        (self.port,) = free_ports(1)
        secret = folder / "password"
        secret.write_text(password)
        if self._as:
            shutil.chown(secret, "postgres")
        access = ["-A", "scram-sha-256", f"--pwfile={secret}"]
        self.run("initdb", "-D", str(folder / "data"), "-U", user, *access, "--no-sync")
        self.start()
        self.url = f"postgresql://{user}:{password}@127.0.0.1:{self.port}/{database}"
        self.environment = {"PGPASSWORD": password, "PGHOST": "127.0.0.1", "PGPORT": str(self.port), "PGUSER": user}
        self.run("createdb", database)

    def start(self) -> None:
        """Starts it, again too."""
        options = f"-p {self.port} -c listen_addresses=127.0.0.1 -c unix_socket_directories={self._folder}"
        log = str(self._folder / "log")
        self.run("pg_ctl", "-D", str(self._folder / "data"), "start", "-w", "-o", options, "-l", log)

    def run(self, program: str, *arguments: str) -> str:
        """What one of Postgres' programs prints."""
        command = [*self._as, str(self._programs / program), *arguments]
        environment = os.environ | getattr(self, "environment", {})
        with (self._folder.parent / f"{program}.out").open("w+") as out:  # a server would keep a pipe open
            done = subprocess.run(command, cwd="/", stdout=out, stderr=out, env=environment, timeout=PATIENCE)
            out.seek(0)
            printed = out.read()
        assert done.returncode == 0, printed
        return printed

    def feed(self, text: str, program: str, *arguments: str) -> None:
        """Runs one of Postgres' programs on a text."""
        file = self._folder.parent / "fed"
        file.write_text(text)
        self.run(program, *arguments, "--file", str(file))

    def stop(self) -> None:
        """Ends it at once, as a crash does."""
        self.run("pg_ctl", "-D", str(self._folder / "data"), "stop", "-m", "immediate")


@contextmanager
def postgres_of_jobs() -> Iterator[Postgres]:
    """A Postgres server with a database for jobs, until the context ends."""
    with tempfile.TemporaryDirectory() as folder:  # pytest's own are closed to other users
        Path(folder).chmod(0o755)
        (Path(folder) / "server").mkdir()
        server = Postgres(Path(folder) / "server", "worker", "jobs", "secret")
        try:
            yield server
        finally:
            server.stop()


class SeaweedFS:
    """An S3 server.

    Args:
        folder: that holds it.
        command: how it is started, with `-NAME=VALUE` for whatever the test says otherwise.
        environment: the credentials of its administrator.
    """

    def __init__(self, folder: Path, command: list[str], environment: dict[str, str]) -> None:
        parts = ("master", "volume", "filer", "s3")
        ports = free_ports(2 * len(parts))
        own = {f"{part}.port": port for part, port in zip(parts, ports, strict=False)}
        own |= {f"{part}.port.grpc": port for part, port in zip(parts, ports[len(parts) :], strict=True)}
        given = {"ip": "127.0.0.1", "ip.bind": "127.0.0.1", "dir": folder} | own
        kept = [word for word in command if word.lstrip("-").partition("=")[0] not in given]
        words = [*kept, *(f"-{name}={value}" for name, value in given.items())]
        self.address = f"127.0.0.1:{own['s3.port']}"
        self._log = folder / "log"
        with self._log.open("wb") as log:
            self._process = subprocess.Popen(
                [str(Path(sys.executable).with_name("weed")), *words],
                stdout=log,
                stderr=log,
                env=os.environ | environment,
            )
        until = time.monotonic() + PATIENCE
        while not self._answers():
            assert self._process.poll() is None, self._log.read_text()
            assert time.monotonic() < until, self._log.read_text()
            time.sleep(0.1)

    def _answers(self) -> bool:
        try:
            return httpx.get(f"http://{self.address}/healthz").status_code == 200
        except httpx.TransportError:
            return False

    def stop(self) -> None:
        """Ends it."""
        self._process.kill()
        self._process.wait()
