"""Proves the Dockerfiles where there is no Docker: does what they say, step by step, and uses what comes of it.

    python3 docker/prove.py [api] [worker]      as root, on a Debian with debootstrap; 10 minutes, 8 GB
    python3 docker/prove.py --built             what was built before, once more; 2 minutes

`roots.py` builds the images as folders. Then containers are played: as the image's user, with the image's environment
and command, in namespaces of their own.
"""

from __future__ import annotations

import argparse
import json
import os
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dockerfile import read
from roots import ROOT, Image, base_of, build, home_of, inside

BUILD_TOOLS = ["c++", "cc", "curl", "gcc", "git", "ld", "make", "pip", "pip3", "uv", "wget"]
PATIENCE = 300.0  # seconds


class Container:
    """A container of an image.

    Args:
        image: the image.
        data: a folder of this machine, as the volume /data.
        mounts: further ones, and where they are seen.
        read_only: whether nothing else may be written, as in docker/kubernetes.
        settings: variables beside those of the image.
    """

    def __init__(
        self,
        image: Image,
        data: Path,
        mounts: dict[Path, str] | None = None,
        *,
        read_only: bool = False,
        **settings: str,
    ) -> None:
        self._image = image
        self.words = inside(
            image.root,
            image.user,
            image.stage.said("WORKDIR")[-1],
            {"HOME": home_of(image.user, image.root)} | image.stage.environment() | settings,
            {data: "/data"} | (mounts or {}),
            read_only=read_only,
        )

    def run(self, *command: str) -> str:
        """What a command prints; it must succeed."""
        done = subprocess.run([*self.words, *command], capture_output=True, text=True, check=False)
        if done.returncode:
            raise SystemExit(f"{command} failed ({done.returncode}):\n{done.stdout[-2000:]}{done.stderr[-4000:]}")
        return done.stdout

    def succeeds(self, *command: str) -> bool:
        """Whether a command does."""
        return subprocess.run([*self.words, *command], capture_output=True, check=False).returncode == 0

    @contextmanager
    def started(self, log: Path) -> Iterator[subprocess.Popen[bytes]]:
        """The image's own command, as process 1; ended by SIGTERM, as Docker does, with exit code 0."""
        with log.open("wb") as stderr:
            process = subprocess.Popen([*self.words, *self._image.stage.command()], stderr=stderr)
        try:
            yield process
            children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
            os.kill(int(children[0]), signal.SIGTERM)
            check(process.wait(60) == 0, "ends at SIGTERM with exit code 0")
        finally:
            process.kill()
            process.wait()


def check(holds: bool, what: str) -> None:
    """Says that something holds, or ends."""
    if not holds:
        raise SystemExit(f"NOT: {what}")
    print(f"  ok  {what}", flush=True)


def check_image(image: Image, data: Path) -> Container:
    """What holds of both images."""
    container = Container(image, data)
    user = container.run("id", "-u").strip()
    check(user == image.user.partition(":")[0] != "0", f"runs as user {user}")
    tools = [tool for tool in BUILD_TOOLS if container.succeeds("sh", "-c", f"command -v {tool}")]
    tools += [name for name in ("pip", "ensurepip") if container.succeeds("python", "-c", f"import {name}")]
    check(not tools, f"has no build tools {tools or ''}")
    writable = container.run("sh", "-c", "find /opt /usr /etc -not -type l -writable 2>/dev/null || true")
    check(not writable, "can write nothing of the program")
    return container


def kernels(image: Image, mounts: dict[Path, str] | None = None) -> set[Path]:
    """The compiled kernels that a container of an image finds."""
    cache = image.stage.environment()["NUMBA_CACHE_DIR"]
    mounted = [source for source, target in (mounts or {}).items() if target == cache]
    return {file for folder in mounted or [image.root / cache.lstrip("/")] for file in folder.rglob("*.nb?")}


def wait_for(healthy: Container, image: Image, process: subprocess.Popen[bytes], log: Path) -> float:
    """Waits until the image's HEALTHCHECK passes, and says after how many seconds it did."""
    began = time.monotonic()
    while not healthy.succeeds(*image.stage.health()):
        if process.poll() is not None or time.monotonic() - began > PATIENCE:
            raise SystemExit(f"not healthy: see {log}\n{log.read_text()[-4000:]}")
        time.sleep(0.2)
    return time.monotonic() - began


def ask(address: str, key: str = "", body: bytes | None = None) -> tuple[int, dict[str, Any]]:
    """Status and document of an answer."""
    request = urllib.request.Request(address, body, {"Authorization": f"Bearer {key}"} if key else {})
    try:
        with urllib.request.urlopen(request, timeout=60) as answer:
            return answer.status, json.load(answer)
    except urllib.error.HTTPError as error:
        return error.code, json.load(error)


def free_port() -> int:
    """A TCP port that nobody listens on."""
    with socket.create_server(("127.0.0.1", 0)) as found:
        return int(found.getsockname()[1])


def prove_api(image: Image, data: Path) -> None:
    """Starts the service and asks it."""
    container = check_image(image, data)
    absent = ("worker", "sapien", "open3d", "sklearn")
    check(not any(container.succeeds("python", "-c", f"import {name}") for name in absent), f"has none of {absent}")
    check(not container.succeeds("shape-concepts", "serve", "--port", "0"), "does not listen without access keys")
    example = "from service.transports.rest.examples import CLOUD_XYZ; print(CLOUD_XYZ)"
    cloud = container.run("python", "-c", example).encode()
    key = json.loads(container.run("shape-concepts", "keys", "create", "prover", "--json"))["key"]
    serve_and_ask(image, data, key, cloud, data.parent / "api.log")
    kept = data.parent / "kernels"
    shutil.rmtree(kept, ignore_errors=True)
    kept.mkdir()
    os.chown(kept, *map(int, image.user.split(":")))
    cache = image.stage.environment()["NUMBA_CACHE_DIR"]
    Container(image, data, {kept: "/kernels"}, read_only=True).run("cp", "--recursive", f"{cache}/.", "/kernels")
    print("  with a read-only root, as in docker/kubernetes/api.yaml:")
    serve_and_ask(image, data, key, cloud, data.parent / "api.log", {kept: cache}, read_only=True)


def serve_and_ask(
    image: Image,
    data: Path,
    key: str,
    cloud: bytes,
    log: Path,
    mounts: dict[Path, str] | None = None,
    *,
    read_only: bool = False,
) -> None:
    """Starts the service, asks for its health and about a cloud, and ends it."""
    port, grpc = str(free_port()), str(free_port())
    ports = {"SHAPE_CONCEPTS_PORT": port, "SHAPE_CONCEPTS_GRPC_PORT": grpc}
    served = Container(image, data, mounts, read_only=read_only, **ports)
    compiled, address = kernels(image, mounts), f"http://127.0.0.1:{port}"
    with served.started(log) as process:
        print(f"  ok  healthy after {wait_for(served, image, process, log):.1f} s")
        check(ask(f"{address}/healthz")[0] == 200, "GET /healthz: 200")
        status, ready = ask(f"{address}/readyz")
        check(status == 200, f"GET /readyz: {ready}")
        check(ask(f"{address}/v1/responses", body=cloud)[0] == 401, "a cloud without a key: 401")
        began = time.monotonic()
        status, answer = ask(f"{address}/v1/responses?top=1&detail=concepts", key, cloud)
        took = time.monotonic() - began
        check(status == 200, f"the first cloud, after {took:.2f} s: {json.dumps(answer)[:160]}...")
    check(len(compiled) > 20 and kernels(image, mounts) == compiled, f"had all kernels compiled: {len(compiled)} files")


def prove_worker(image: Image, data: Path) -> None:
    """Learns from objects that SAPIEN renders, at once and as a job."""
    container = check_image(image, data)
    compiled, began = kernels(image), time.monotonic()
    published = container.run("shape-concepts-worker", "train", "--simulate", "12", "--name", "tiny", "--json")
    renderer = json.loads(published)["source"]["parameters"]["renderer"]
    check(renderer == "sapien", f"SAPIEN renders and a model is learnt: {time.monotonic() - began:.1f} s")
    container.run("shape-concepts", "jobs", "submit", "--simulate", "6", "--name", "tiny", "--id", "proof")
    log = data.parent / "worker.log"
    with container.started(log) as process:
        print(f"  ok  healthy after {wait_for(container, image, process, log):.1f} s")
        until = time.monotonic() + PATIENCE
        while (job := show_job(container, "proof"))["state"] != "done":
            if job["state"] == "failed" or time.monotonic() > until:
                raise SystemExit(f"the job: {job}\n{log.read_text()[-4000:]}")
            time.sleep(1)
        check(job["result"]["version"] == 2, f"a job: {job['result']}")
    check(len(compiled) > 20 and kernels(image) == compiled, f"had all kernels compiled: {len(compiled)} files")


def show_job(container: Container, job: str) -> dict[str, Any]:
    """A job as it stands."""
    shown: dict[str, Any] = json.loads(container.run("shape-concepts", "jobs", "show", job, "--json"))
    return shown


def tell_size(image: Image, work: Path) -> None:
    """Prints the image's size, as Docker shows it and as it is sent."""
    sizes = {}
    for name, root in (("base", base_of(image.stage.base, work)), ("image", image.root)):
        sizes[name] = int(subprocess.check_output(["du", "-sb", str(root)]).split()[0]) / 1e6
    packed = subprocess.run(
        f"tar -C {shlex.quote(str(image.root))} -c . | gzip -3 | wc -c", shell=True, capture_output=True, check=True
    )
    print(
        f"  {sizes['image']:.0f} MB, of which Debian {sizes['base']:.0f} MB; packed {int(packed.stdout) / 1e6:.0f} MB"
    )


def main() -> None:
    """Builds and proves the images that are named; the worker first, so that the service answers with its model."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("images", nargs="*", default=["worker", "api"], metavar="IMAGE", help="api, worker")
    parser.add_argument("--work", type=Path, default=Path("/var/tmp/shape-concepts-images"), help="folder to build in")
    parser.add_argument("--built", action="store_true", help="prove again what was built before")
    given = parser.parse_args()
    if unknown := set(given.images) - {"api", "worker"}:
        parser.error(f"no image is called {unknown.pop()}; there are api and worker")
    if os.geteuid():
        sys.exit("needs root: chroot and debootstrap do")
    given.work.mkdir(parents=True, exist_ok=True)
    data = given.work / "data"
    shutil.rmtree(data, ignore_errors=True)
    data.mkdir()
    for name in sorted(given.images, reverse=True):
        began = time.monotonic()
        if given.built:
            image = Image(given.work / f"{name}-image", read(ROOT / "docker" / f"{name}.Dockerfile")[-1])
        else:
            image = build(name, given.work)
        print(f"{name}: built in {time.monotonic() - began:.0f} s", flush=True)
        os.chown(data, *map(int, image.user.split(":")))
        if name == "api":
            prove_api(image, data)
        else:
            prove_worker(image, data)
        tell_size(image, given.work)


if __name__ == "__main__":
    main()
