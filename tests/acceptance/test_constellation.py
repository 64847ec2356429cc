"""docker/compose.yaml as real processes: the same services and settings, on the loopback address."""

from __future__ import annotations

import json
import os
import re
import signal
import struct
import subprocess
import sys
import tempfile
import time
import uuid
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import httpx
import pytest
import yaml
import zenoh

from service.clouds import write_ply
from tests.acceptance.servers import Postgres, SeaweedFS, free_ports
from tests.conftest import ROOT
from tests.learnt import objects

PATIENCE = 180.0  # seconds that anything may take
GIVEN = {
    "POSTGRES_PASSWORD": "elephant",
    "S3_ACCESS_KEY": "concepts",
    "S3_SECRET_KEY": "seaweed",
    "ACCESS": "keys",
    "STREAMS": '[{"key": "robots/*/cloud"}]',
}


class Constellation:
    """Postgres, SeaweedFS, and the processes that compose.yaml would start."""

    def __init__(self, folder: Path, postgres: Postgres, objects_server: SeaweedFS, services: dict[str, Any]) -> None:
        self._folder, self._services, self.postgres = folder, services, postgres
        self.moved: dict[str, str] = {}  # what stands for what in every variable
        (self._router,) = free_ports(1)
        self._places = {
            "@database/": f"@127.0.0.1:{postgres.port}/",
            "objects:8333": objects_server.address,
            "router:7447": f"127.0.0.1:{self._router}",
            "0.0.0.0:7447": f"127.0.0.1:{self._router}",
        }
        self.router = f"tcp/127.0.0.1:{self._router}"

    def environment(self, service: str, **more: str) -> dict[str, str]:
        """The variables of a service, with the places of the test's own servers."""
        plain = {name: value for name, value in os.environ.items() if not name.startswith(("SHAPE_CONCEPTS_", "AWS_"))}
        (zenoh_port,) = free_ports(1)
        for name, text in self._services[service]["environment"].items():
            value = substituted(str(text))
            for place, own in (self._places | self.moved | {"0.0.0.0:7448": f"127.0.0.1:{zenoh_port}"}).items():
                value = value.replace(place, own)
            plain[name] = value
        home = self._folder / f"{service}-home"
        return plain | {"XDG_DATA_HOME": str(home), "SHAPE_CONCEPTS_WORKERS": "1"} | more

    @contextmanager
    def started(self, service: str, *command: str, log: str = "", **more: str) -> Iterator[subprocess.Popen[bytes]]:
        """A process of a service; what is left of it in the end is killed."""
        with (self._folder / f"{log or service}.log").open("wb") as stderr:
            process = subprocess.Popen(
                [sys.executable, "-m", *command],
                stderr=stderr,
                env=self.environment(service, **more),
                start_new_session=True,
            )
        try:
            yield process
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()

    @contextmanager
    def replica(self, service: str, number: int) -> Iterator[str]:
        """A running service that answers; its address."""
        port, grpc = map(str, free_ports(2))
        more = {"SHAPE_CONCEPTS_PORT": port, "SHAPE_CONCEPTS_HOST": "127.0.0.1"}
        if "SHAPE_CONCEPTS_GRPC_PORT" not in self._services[service]["environment"]:
            more["SHAPE_CONCEPTS_GRPC_PORT"] = grpc
        log = f"{service}-{number}"
        with self.started(service, "service.cli", "serve", log=log, **more) as process:
            environment, health = os.environ | more, [sys.executable, str(ROOT / "docker" / "health.py")]
            until = time.monotonic() + PATIENCE
            while subprocess.run(health, env=environment, capture_output=True, check=False).returncode:
                text = (self._folder / f"{log}.log").read_text()
                assert process.poll() is None, text
                assert time.monotonic() < until, text
                time.sleep(0.2)
            yield f"http://127.0.0.1:{port}"

    def call(self, *arguments: str) -> dict[str, Any]:
        """What `docker compose run --rm api ... --json` would print."""
        command = [sys.executable, "-m", "service.cli", *arguments, "--json"]
        done = subprocess.run(
            command, env=self.environment("api"), capture_output=True, text=True, timeout=PATIENCE, check=False
        )
        assert done.returncode == 0, done.stderr
        answer: dict[str, Any] = json.loads(done.stdout)
        return answer

    def copy_store(self, source: str, target: str) -> None:
        """Runs docker/copy_store.py."""
        command = [sys.executable, str(ROOT / "docker" / "copy_store.py"), source, target]
        subprocess.run(command, env=self.environment("api"), check=True, timeout=PATIENCE)

    def until_done(self, job: str) -> dict[str, Any]:
        until = time.monotonic() + PATIENCE
        while (shown := self.call("jobs", "show", job))["state"] != "done":
            assert shown["state"] in ("queued", "running"), shown
            assert time.monotonic() < until, (self._folder / "worker.log").read_text()
            time.sleep(0.5)
        return shown


def substituted(text: str) -> str:
    """Compose's ${NAME}, ${NAME:-default} and ${NAME:?message}, as the environment file gives them."""
    return re.sub(r"\$\{(\w+)(?::[-?][^}]*)?\}", lambda found: GIVEN[found[1]], text)


@pytest.fixture
def constellation(tmp_path: Path) -> Iterator[Constellation]:
    services: dict[str, Any] = yaml.safe_load((ROOT / "docker" / "compose.yaml").read_text())["services"]
    with ExitStack() as stack:
        # pytest's own folders are closed to other users
        open_folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        open_folder.chmod(0o755)
        (open_folder / "postgres").mkdir()
        names = {name: substituted(str(value)) for name, value in services["database"]["environment"].items()}
        postgres = Postgres(
            open_folder / "postgres", names["POSTGRES_USER"], names["POSTGRES_DB"], names["POSTGRES_PASSWORD"]
        )
        stack.callback(postgres.stop)
        (tmp_path / "objects").mkdir()
        server = services["objects"]
        credentials = {name: substituted(str(value)) for name, value in server["environment"].items()}
        seaweed = SeaweedFS(tmp_path / "objects", server["command"], credentials)
        stack.callback(seaweed.stop)
        yield Constellation(tmp_path, postgres, seaweed, services)


@contextmanager
def robot(router: str) -> Iterator[zenoh.Session]:
    config = zenoh.Config()
    config.insert_json5("mode", json.dumps("client"))
    config.insert_json5("connect/endpoints", json.dumps([router]))
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config) as session:
        yield session


@pytest.mark.slow
def test_what_compose_starts_trains_and_serves_on_every_replica_and_over_the_router(
    constellation: Constellation,
) -> None:
    cloud = write_ply(objects()[0].cloud)
    key = constellation.call("keys", "create", "robot")["key"]  # which also makes the bucket
    headers = {"Authorization": f"Bearer {key}"}
    with ExitStack() as stack:
        stack.enter_context(constellation.replica("router", 1))
        replicas = [stack.enter_context(constellation.replica("api", number)) for number in (1, 2)]
        stack.enter_context(constellation.started("worker", "worker.cli", "run", "--workers", "1"))
        assert httpx.post(f"{replicas[0]}/v1/responses", content=cloud).status_code == 401

        constellation.call(
            "jobs", "submit", "--simulate", "6", "--renderer", "raycast", "--name", "toys", "--id", "one"
        )
        assert constellation.until_done("one")["result"]["version"] == 1

        answers = []
        for address in replicas:
            until = time.monotonic() + 30
            while (ready := httpx.get(f"{address}/readyz").json()).get("model") != "toys":
                assert time.monotonic() < until, ready  # a new model is taken up within seconds
                time.sleep(0.2)
            answers.append(httpx.post(f"{address}/v1/responses", headers=headers, content=cloud, timeout=60).json())
        assert [(answer["model"], answer["version"]) for answer in answers] == [("toys", 1)] * 2
        assert answers[0]["responses"] == answers[1]["responses"]

        with robot(constellation.router) as session:
            living = {
                str(reply.ok.key_expr)
                for reply in session.liveliness().get("shape-concepts/@v1/replicas/*")
                if reply.ok
            }
            assert len(living) == 3
            selector = "shape-concepts/@v1/models/toys/respond"
            (reply,) = session.get(selector, payload=cloud, attachment=key.encode(), timeout=60)
            assert reply.ok is not None, reply.err.payload.to_string() if reply.err else ""
            assert json.loads(reply.ok.payload.to_bytes())["responses"] == answers[0]["responses"]

            heard: list[dict[str, Any]] = []
            listening = session.declare_subscriber(
                "robots/9/cloud/concepts", lambda sample: heard.append(json.loads(sample.payload.to_bytes()))
            )
            for sequence in range(5):
                identity = uuid.uuid4().bytes
                attachment = struct.pack("<qqB", sequence, time.time_ns(), len(identity)) + identity
                session.put("robots/9/cloud", cloud, attachment=attachment)
                time.sleep(1)
            until = time.monotonic() + 30
            while sum(1 + answer["dropped"] for answer in heard) < 5 and time.monotonic() < until:
                time.sleep(0.1)
            listening.undeclare()
            numbers = [answer["source"]["sequence"] for answer in heard]
            assert numbers == sorted(set(numbers))  # two replicas share the stream, and none is answered twice
            assert numbers[-1] == 4
            assert {answer["model"] for answer in heard} == {"toys"}


@pytest.mark.slow
def test_what_was_backed_up_is_restored_beside_it_and_goes_on(constellation: Constellation, tmp_path: Path) -> None:
    """The commands of docs/operations.md: the worker ends, the database is dumped, the store is copied after it."""
    key = constellation.call("keys", "create", "robot")["key"]
    train = ("jobs", "submit", "--simulate", "6", "--renderer", "raycast", "--name", "toys", "--id")
    with constellation.started("worker", "worker.cli", "run", "--workers", "1") as worker:
        constellation.call(*train, "one")
        constellation.until_done("one")
        constellation.call(*train, "two")  # at work, or still waiting, when the worker ends
        worker.send_signal(signal.SIGTERM)
        assert worker.wait(PATIENCE) == 0
    dump = constellation.postgres.run("pg_dump", "--no-owner", "shape_concepts")
    constellation.copy_store("s3://shape-concepts/store", str(tmp_path / "backup"))

    constellation.postgres.run("createdb", "restored")
    constellation.postgres.feed(dump, "psql", "--quiet", "--set=ON_ERROR_STOP=1", "restored")
    constellation.copy_store(str(tmp_path / "backup"), "s3://shape-concepts/restored")
    port = constellation.postgres.port
    constellation.moved = {
        "s3://shape-concepts/store": "s3://shape-concepts/restored",
        f"{port}/shape_concepts": f"{port}/restored",
    }

    assert constellation.call("jobs", "show", "one")["result"]["version"] == 1
    assert [listed["id"] for listed in constellation.call("keys", "list")["keys"]] == [key.split("_")[1]]
    with constellation.started("worker", "worker.cli", "run", "--workers", "1"):
        assert constellation.until_done("two")["result"]["version"] == 2
    assert constellation.call("models", "list")["models"][0]["versions"] == [1, 2]
