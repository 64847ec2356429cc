"""The main job from end to end, `./run demo [FILE...]`: simulate, learn, publish, serve, ask over REST.

You will see each command and each request as it is made, and the concepts that the clouds resemble, best first. The
model stays in the folder `demo`, so that only the first time takes minutes.
"""

from __future__ import annotations

import json
import os
import shlex
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import click

from service.answer import Answer
from service.store import ModelStore
from service.tables import show_answer

ROOT = Path(__file__).resolve().parent.parent
MODEL = "demo"
OBJECTS, SEED = 250, 7
UNSEEN_SEED = 8  # of an object that the model has not learned from
TOP = 5  # concepts that are listed
STARTING = 120.0  # seconds that the service may take to answer its first request


@click.command()
@click.argument("files", nargs=-1, metavar="[FILE]...", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--count", default=OBJECTS, show_default=True, type=click.IntRange(min=2), help="Objects to learn from.")
@click.option("--folder", default=ROOT / "demo", type=click.Path(path_type=Path), help="Where the model is kept.")
def main(files: tuple[Path, ...], count: int, folder: Path) -> None:
    """Learns concepts from simulated objects, and asks a service about clouds: FILEs, or a new simulated object."""
    store = str(folder / "store")
    if MODEL not in ModelStore(store).names():
        say(f"Simulating {count} objects, learning concepts from them and publishing the model: the first time only.")
        learn = ("train", "--simulate", str(count), "--seed", str(SEED), "--name", MODEL, "--store", store)
        call("shape-concepts-worker", *learn, *renderer())
    files = files or (unseen_object(folder / "unseen"),)
    say("Starting the service, and asking it.")
    with service(store) as address:
        answered = [ask(address, file) for file in files]
    say(f"The service has been stopped. The model is kept in {folder}; remove that folder to begin anew.")
    click.echo(f"Try it yourself: ./run serve --store {shlex.quote(store)}, then curl as above, at port 8000.")
    sys.exit(not all(answered))


def unseen_object(folder: Path) -> Path:
    """The file of a simulated cloud that the model has not learned from; simulates it where there is none yet."""
    if not list(folder.glob("*.ply")):
        say("Simulating one more object, of another seed, to ask about.")
        simulate = ("simulate", "--count", "1", "--orders", "3", "--seed", str(UNSEEN_SEED), "--out", str(folder))
        call("shape-concepts-worker", *simulate, *renderer())
    return min(folder.glob("*.ply"))


def renderer() -> Sequence[str]:
    """Arguments that choose what renders here: SAPIEN, or ray casting where it finds no Vulkan driver."""
    from worker.simulation.scene import unavailable

    reason = unavailable()
    if reason:
        say(f"SAPIEN cannot render here, so objects are rendered by ray casting instead: {reason}")
    return ("--renderer", "raycast") if reason else ()


def ask(address: str, file: Path) -> bool:
    """Sends a cloud, shows the request and its answer; False where the service refused it."""
    url = f"{address}/v1/responses?model={MODEL}&top={TOP}"
    kind = "Content-Type: application/octet-stream"
    show(["curl", "--silent", "--header", kind, "--data-binary", f"@{file}", url])
    request = urllib.request.Request(url, file.read_bytes(), dict([kind.split(": ")]))
    try:
        with urllib.request.urlopen(request) as reply:
            show_answer(file.name, Answer.model_validate_json(reply.read()))
    except urllib.error.HTTPError as error:
        problem = json.load(error)
        click.echo(f"{error.code} {problem['title']}: {problem['detail']}", err=True)
        return False
    return True


@contextmanager
def service(store: str) -> Iterator[str]:
    """The address of a service on that store, which is stopped at the end.

    Raises:
        ClickException: it did not start, or cannot answer.
    """
    port = free_port()
    address = f"http://127.0.0.1:{port}"
    command = script("shape-concepts", "serve", "--store", store, "--port", str(port), "--grpc-port", "-1")
    show(command)
    process = subprocess.Popen(command, env=os.environ | {"SHAPE_CONCEPTS_LOG_LEVEL": "warning"})
    try:
        wait_until_ready(process, f"{address}/readyz")
        yield address
    finally:
        process.terminate()
        process.wait()


def wait_until_ready(process: subprocess.Popen[bytes], url: str) -> None:
    """Waits until the service says that it can answer."""
    deadline = time.monotonic() + STARTING
    while process.poll() is None and time.monotonic() < deadline:
        try:
            with urllib.request.urlopen(url, timeout=STARTING):
                return
        except urllib.error.HTTPError as error:
            raise click.ClickException(f"The service is not ready: {json.load(error)['detail']}") from error
        except OSError:
            time.sleep(0.1)
    raise click.ClickException("The service did not start.")


def free_port() -> int:
    """A TCP port of the loopback interface that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def call(name: str, *arguments: str) -> None:
    """Runs one of the project's commands, and ends with its exit code where it fails."""
    command = script(name, *arguments)
    show(command)
    code = subprocess.run(command).returncode
    if code:
        sys.exit(code)


def script(name: str, *arguments: str) -> list[str]:
    """The command line of one of the project's commands, as installed beside this Python."""
    return [str(Path(sys.executable).with_name(name)), *arguments]


def show(command: Sequence[str]) -> None:
    """Prints a command as one would type it in the project's folder."""
    click.echo(f"$ {shlex.join(command)}".replace(f"{ROOT}/", ""))


def say(sentence: str) -> None:
    """Prints what happens next."""
    click.echo(f"\n==> {sentence}")


if __name__ == "__main__":
    main(prog_name="./run demo")
