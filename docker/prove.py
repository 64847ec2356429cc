"""Proves the Dockerfiles where there is no Docker: does what they say, step by step, and uses what comes of it.

    python3 docker/prove.py [api] [worker]      as root, on a Debian with debootstrap; 10 minutes for both

Each stage is a folder with a bootstrapped Debian in which the RUN lines are run by chroot, in namespaces of their own;
nothing stays mounted. Then containers are played the same way: as the image's user, with the image's environment and
command. Package sources, certificates and pip's settings are this machine's, and only there while an image is built.
"""

from __future__ import annotations

import argparse
import json
import os
import re
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
from typing import Any, NamedTuple

from dockerfile import Copy, Stage, context, copied, read, variables

ROOT = Path(__file__).resolve().parent.parent
CERTIFICATES = Path("/etc/ssl/certs/ca-certificates.crt")
SLIM = ["usr/share/doc", "usr/share/man", "usr/share/locale", "usr/share/info", "var/cache/apt", "var/lib/apt/lists"]
BUILD_TOOLS = ["apt-listchanges", "c++", "cc", "curl", "gcc", "git", "ld", "make", "pip", "pip3", "uv", "wget"]
PATIENCE = 300.0  # seconds


class Image(NamedTuple):
    """An image: the folder that is its root, and its last stage."""

    root: Path
    stage: Stage

    @property
    def user(self) -> str:
        """The user that its containers are, "UID:GID"."""
        return self.stage.said("USER")[-1]


def inside(root: Path, user: str, folder: str, environment: dict[str, str], mounts: dict[Path, str]) -> list[str]:
    """The words before a command that run it in a root, as init of its own namespaces, and end all that it started.

    Args:
        root: the folder.
        user: "UID:GID".
        folder: to run it in.
        environment: all of its variables.
        mounts: files and folders of this machine, and where they are seen.
    """
    there = shlex.quote(str(root))
    steps = ["mount --make-rprivate /", f"mount -t proc proc {there}/proc", f"mount --rbind /dev {there}/dev"]
    steps.append(f"mount -t tmpfs -o mode=1777 tmpfs {there}/tmp")
    for source, target in mounts.items():
        kind = "mkdir -p" if source.is_dir() else "touch"
        steps.append(f"{kind} {there}{target} && mount --bind {shlex.quote(str(source))} {there}{target}")
    given = shlex.join(f"{name}={value}" for name, value in environment.items())
    steps.append(f'exec chroot --userspec={user} {there} env -i {given} sh -c \'cd "$0" && exec "$@"\' {folder} "$@"')
    script = " && ".join(steps)
    return ["unshare", "--mount", "--pid", "--fork", "--kill-child", "sh", "-c", script, "sh"]


def base_of(image: str, work: Path) -> Path:
    """A bootstrapped Debian in place of the image debian:SUITE-slim; made once."""
    suite = re.fullmatch(r"debian:([a-z]+)-slim", image)
    if suite is None:
        raise SystemExit(f"{image} cannot be made here: only debian:SUITE-slim")
    root = work / f"base-{suite[1]}"
    if not (root / "made").exists():
        print(f"==> bootstrapping {image}", flush=True)
        shutil.rmtree(root, ignore_errors=True)
        here = re.search(r"^VERSION_CODENAME=(.*)$", Path("/etc/os-release").read_text(), re.M)
        sources = Path("/etc/apt/sources.list.d/debian.sources").read_text()
        mirror = re.search(r"^URIs: (\S+)", sources, re.M)
        assert here is not None and mirror is not None
        subprocess.run(
            ["debootstrap", "--variant=minbase", suite[1], str(root), mirror[1]], check=True, stdout=subprocess.DEVNULL
        )
        (root / "etc/apt/sources.list").unlink(missing_ok=True)
        (root / "etc/apt/sources.list.d/debian.sources").write_text(sources.replace(here[1], suite[1]))
        (root / "etc/dpkg/dpkg.cfg.d/slim").write_text("".join(f"path-exclude=/{path}/*\n" for path in SLIM[:4]))
        for path in SLIM:
            shutil.rmtree(root / path, ignore_errors=True)
            (root / path).mkdir()
        (root / "etc/resolv.conf").write_text("")
        (root / "made").touch()
    return root


def build(name: str, work: Path) -> Image:
    """Does what a Dockerfile says; returns the image of its last stage."""
    file = ROOT / "docker" / f"{name}.Dockerfile"
    seen = copy_context(file, work / f"{name}-context")
    roots: dict[str, Path] = {}
    stages = read(file)
    for number, stage in enumerate(stages):
        root = work / f"{name}-{stage.name or 'image'}"
        shutil.rmtree(root, ignore_errors=True)
        base = roots.get(stage.base) or base_of(stage.base, work)
        subprocess.run(["cp", "-a", "--reflink=auto", str(base), str(root)], check=True)
        do_stage(stage, root, seen, roots)
        (root / "run/certificates.crt").unlink(missing_ok=True)
        roots[stage.name or str(number)] = root
    return Image(root, stages[-1])


def copy_context(file: Path, folder: Path) -> Path:
    """What the build sees of the repository: files that are in git or would be, without what is ignored."""
    listed = ["git", "-C", str(ROOT), "ls-files", "--cached", "--others", "--exclude-standard"]
    paths = subprocess.run(listed, capture_output=True, text=True, check=True).stdout.splitlines()
    shutil.rmtree(folder, ignore_errors=True)
    for path in context(paths, file.with_name(f"{file.name}.dockerignore").read_text()):
        if (ROOT / path).is_file():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / path, folder / path)
    return folder


def do_stage(stage: Stage, root: Path, seen: Path, roots: dict[str, Path]) -> None:
    """Does the steps of a stage in its root."""
    user, folder = "0:0", "/"
    environment = {"PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin", "HOME": "/root"}
    ours = {name: value for name, value in os.environ.items() if name.startswith("PIP_") and name != "PIP_FIND_LINKS"}
    ours |= {"PIP_CERT": "/run/certificates.crt", "DEBIAN_FRONTEND": "noninteractive"}
    mounts = {CERTIFICATES: "/run/certificates.crt", Path("/etc/resolv.conf").resolve(): "/etc/resolv.conf"}
    for step in stage.steps:
        match step.word:
            case "ENV":
                environment |= variables(step.rest)
            case "USER":
                user = step.rest
                environment["HOME"] = home_of(user, root)
            case "WORKDIR":
                folder = step.rest
                (root / folder.lstrip("/")).mkdir(parents=True, exist_ok=True)
            case "COPY":
                copy(copied(step.rest), root, folder, seen, roots)
            case "RUN":
                print(f"==> RUN {step.rest[:150]}", flush=True)
                words = inside(root, user, folder, ours | environment, mounts)
                with (root.parent / f"{root.name}.log").open("ab") as log:
                    done = subprocess.run([*words, "/bin/sh", "-c", step.rest], stdout=log, stderr=log, check=False)
                if done.returncode:
                    raise SystemExit(f"failed ({done.returncode}): {step.rest}\nsee {root}.log")


def home_of(user: str, root: Path) -> str:
    """The home folder of a user, "UID:GID"."""
    entries = [line.split(":") for line in (root / "etc/passwd").read_text().splitlines()]
    return next(entry[5] for entry in entries if entry[2] == user.partition(":")[0])


def copy(said: Copy, root: Path, folder: str, seen: Path, roots: dict[str, Path]) -> None:
    """Does a COPY: files into a folder, or the content of a folder into another."""
    place = root / os.path.join(folder, said.target).lstrip("/")
    for source in said.sources:
        path = (roots[said.stage] if said.stage else seen) / source.lstrip("/")
        if path.is_dir():
            place.mkdir(parents=True, exist_ok=True)
            subprocess.run(["cp", "-a", f"{path}/.", str(place)], check=True)
        elif said.target.endswith("/") or len(said.sources) > 1:
            place.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, place / path.name)
        else:
            shutil.copy(path, place)


class Container:
    """A container of an image, with a folder of this machine as its volume /data."""

    def __init__(self, image: Image, data: Path, **settings: str) -> None:
        self._image = image
        self.words = inside(
            image.root,
            image.user,
            image.stage.said("WORKDIR")[-1],
            {"HOME": home_of(image.user, image.root)} | image.stage.environment() | settings,
            {data: "/data"},
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
    tools += [
        name for name in ("pip", "setuptools", "ensurepip") if container.succeeds("python", "-c", f"import {name}")
    ]
    check(not tools, f"has no build tools {tools or ''}")
    writable = container.run("sh", "-c", "find /opt /usr /etc -not -type l -writable 2>/dev/null || true")
    check(not writable, "can write nothing of the program")
    return container


def kernels(image: Image) -> set[Path]:
    """The compiled kernels that an image has."""
    return set((image.root / image.stage.environment()["NUMBA_CACHE_DIR"].lstrip("/")).rglob("*.nb?"))


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
    port = free_port()
    served = Container(image, data, SHAPE_CONCEPTS_PORT=str(port), SHAPE_CONCEPTS_GRPC_PORT=str(free_port()))
    compiled, log, address = kernels(image), data.parent / "api.log", f"http://127.0.0.1:{port}"
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
    check(len(compiled) > 20 and kernels(image) == compiled, f"had all kernels compiled: {len(compiled)} files")


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
