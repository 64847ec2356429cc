"""What holds of every command: its help, the examples in it, and what is said, where and with which exit code."""

from __future__ import annotations

import glob
import json
import shlex
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import numpy as np
import pytest

from service.archives import write
from service.cli import main
from service.clouds import write_ply
from service.engine.cloud import PointCloud
from service.engine.model import ShapeModel
from service.store import ModelStore
from tests.service.clouds.written import png
from tests.service.commands.asked import run
from tests.service.tabletop.seen import set_table
from tests.service.test_archives import NOW
from worker.cli import main as worker


@pytest.mark.parametrize(
    ("arguments", "code", "says"),
    [
        (["respond", "good.ply", "--model", "nobody"], 1, "There is no 'nobody@production'"),
        (["respond", "good.ply", "--model", "No Body"], 1, "NAME@ALIAS"),
        (["models", "show", "tiny:9"], 1, "no version 9"),
        (["models", "rollback", "tiny"], 1, "nothing before"),
        (["models", "list", "--store", "good.ply"], 1, "good.ply"),
        (["models", "list", "--store", "ftp://x"], 1, "ftp://x"),
        (["models", "export", "tiny", "--out", "/proc/nowhere"], 1, "/proc/nowhere"),
        (["respond"], 2, "CLOUD"),
        (["respond", "good.ply", "--time", "2"], 2, "--time"),
        (["respond", "good.ply", "--top", "0"], 2, "--top"),
        (["respond", "good.ply", "--unit", "furlong"], 2, "--unit"),
        (["respond", "good.ply", "--viewpoint", "1,2"], 2, "--viewpoint"),
        (["respond", "good.ply", "--intrinsics", "1,2"], 2, "--intrinsics"),
        (["respond", "good.ply", "--depth-scale", "0.001"], 2, "--intrinsics"),
        (["respond", "good.ply", "--intrinsics", "525,525,0,0", "--depth-scale", "0"], 2, "--depth-scale"),
        (["respond", "good.ply", "--intrinsics", "525,525,0,0"], 1, "depth image"),
        (["respond", "good.ply", "--mask", "none.png"], 2, "--mask"),
        (["respond", "good.ply", "good.ply", "--mask", "bad.ply"], 2, "--mask"),
        (["respond", "good.ply", "--save", "a.html"], 2, "--html FILE"),
        (["respond", *["good.ply"] * 51, "--html", "a.html"], 2, "at most 50"),
        (["respond", "good.ply", "--html", "none/a.html"], 2, "no folder 'none'"),
        (["models", "promote", "tiny"], 2, "tiny:2"),
        (["nonsense"], 2, "nonsense"),
    ],
)
def test_failures_are_one_clear_line_on_stderr(folder: Path, arguments: list[str], code: int, says: str) -> None:
    result = run(*arguments)
    assert result.exit_code == code
    assert result.stdout == ""
    last = result.stderr.splitlines()[-1]
    assert last.startswith("Error: ")
    assert says in last
    assert "Traceback" not in result.stderr


def test_a_setting_out_of_its_bounds_is_named(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SHAPE_CONCEPTS_WORKERS", "none")
    result = run("models", "list")
    assert (result.exit_code, "SHAPE_CONCEPTS_WORKERS" in result.stderr) == (2, True)


def commands(
    command: click.Command = main, path: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    yield path, command
    if isinstance(command, click.Group):
        for name, child in command.commands.items():
            yield from commands(child, (*path, name))


def test_every_command_has_help_on_all_its_options() -> None:
    for path, command in commands():
        result = run(*path, "--help")
        assert result.exit_code == 0
        assert command.help
        for parameter in command.params:
            if isinstance(parameter, click.Option):
                assert parameter.help, f"{path} {parameter.name}"
        if not isinstance(command, click.Group):
            assert "Examples:" in result.stdout


EXAMPLES = [
    line.strip()
    for _, command in commands()
    for line in (command.epilog or "").splitlines()
    if line.strip().startswith("shape-concepts ")
]


@pytest.mark.parametrize("example", EXAMPLES)
def test_every_example_of_the_help_runs(
    folder: Path, store: ModelStore, model: ShapeModel, clouds: list[PointCloud], example: str
) -> None:
    if "--save" in example:
        pytest.importorskip("rerun", reason="rerun-sdk is not installed: ./run test --all installs it")
    if any(word in example for word in ("s3://", " serve", " watch ", " record ", " jobs report ")):
        pytest.skip("needs a bucket or a worker, or never ends: other tests do so")
    for alias in ("production", "staging") * 2:
        store.publish(model, name="default", seed=7, source={}, alias=alias)
    for name in ("mug.pcd", "mug.npy", "mug.xyz"):  # the content tells the format
        shutil.copy("good.ply", name)
    wedge = 700 + 3 * np.abs(np.arange(-40, 40)) + np.arange(60)[:, None]
    Path("depth.png").write_bytes(png(wedge.astype(np.uint16)))
    Path("mask.png").write_bytes(png(np.full(wedge.shape, 255, np.uint8)))
    Path("table.pcd").write_bytes(write_ply(set_table().cloud))
    Path("labels.csv").write_text("file,category\nmug.xyz,mug\n")
    Path("scans").mkdir()
    Path("scans/1.ply").write_bytes(write_ply(PointCloud((clouds[0].points * 1000).astype(np.float32))))
    if " datasets " in example:
        Path("scans.zip").write_bytes(b"".join(write([("1.ply", Path("good.ply").read_bytes())], "zip", NOW)))
        run("datasets", "create", "mugs")
        run("datasets", "add", "mugs", "mug.xyz")
    if "nightly-2025-01-31" in example and " submit " not in example:
        run("jobs", "submit", "--simulate", "1000", "--name", "default", "--id", "nightly-2025-01-31")
    job = {"name": "default", "simulate": 250}
    Path("job.json").write_text(json.dumps(job))
    if " schedules " in example and " weekly" in example and " create " not in example:
        run("schedules", "create", "weekly", "--cron", "0 3 * * mon", "--job", json.dumps(job))
    if " keys revoke " in example:
        made = json.loads(run("keys", "create", "robot-7", "--json").stdout)
        example = example.rpartition(" ")[0] + f" {made['id']}"
    command, _, stdin = example.partition(" < ")
    if "--model" not in command and "respond" in command:
        command += " --model default"
    words = [found for word in shlex.split(command)[1:] for found in sorted(glob.glob(word)) or [word]]
    result = run(*words, stdin=Path(stdin).read_bytes() if stdin else None)
    assert result.exit_code == 0, result.output


def test_no_command_is_listed_with_half_a_sentence() -> None:
    for path, command in (*commands(), *commands(worker, ("worker",))):
        if isinstance(command, click.Group):
            shown = click.Context(command, info_name=" ".join(path), terminal_width=80, max_content_width=80)
            said = command.get_help(shown).partition("Commands:")[2].partition("Examples:")[0]
            assert "..." not in said, said
            assert "(" not in said, said


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["respond", "mm.ply"], "--unit mm"),
        (["respond", "--scene", "ball.ply"], "without --scene"),
        (["respond", "depth.png"], "--intrinsics"),
        (["respond", "."], "It is a folder; give the clouds in it, such as *.ply."),
        (["respond", "good.ply", "--html", "/proc/none.html"], "cannot be written"),
        (["datasets", "show", "nothing"], "shape-concepts datasets list"),
        (["jobs", "show", "nothing"], "shape-concepts jobs list"),
        (["schedules", "show", "nothing"], "shape-concepts schedules list"),
        (["models", "list", "--store", "good.ply"], "Give a folder"),
        (["jobs", "submit", "--name", "toys"], "be such a job: give at least one of"),
        (["jobs", "submit", "--name", "My Toys", "--simulate", "2"], "lower-case letters"),
        (["watch", "robots/**", "--connect", "tcp/127.0.0.1:1"], "any of tcp/127.0.0.1:1. Is the router"),
    ],
)
def test_the_commonest_mistakes_are_told_with_what_to_try(
    folder: Path, clouds: list[PointCloud], arguments: list[str], says: str
) -> None:
    Path("mm.ply").write_bytes(write_ply(PointCloud((clouds[0].points * 1000).astype(np.float32))))
    Path("depth.png").write_bytes(png(np.full((60, 80), 700, np.uint16)))
    around = np.random.default_rng(1).normal(size=(2000, 3))
    ball = (0.05 * around / np.linalg.norm(around, axis=1, keepdims=True) + [0, 0, 1]).astype(np.float32)
    Path("ball.ply").write_bytes(write_ply(PointCloud(ball)))
    result = run(*arguments)
    assert result.exit_code > 0
    last = result.stderr.splitlines()[-1]
    assert last.startswith("Error: ")
    assert says in last, last
    assert "Traceback" not in result.stderr


def test_a_port_in_use_is_said_before_anything_is_loaded(folder: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        for arguments, option in (
            (("--port", port, "--grpc-port", "-1"), "--port"),
            (("--port", "0", "--grpc-port", port), "--grpc-port"),
        ):
            result = run("serve", *arguments, "--store", "/nowhere")
            assert result.exit_code == 1
            (line,) = result.stderr.splitlines()
            assert f"Port {port} of 127.0.0.1: address already in use" in line
            assert f"with {option};" in line


@pytest.mark.parametrize(
    ("value", "says"),
    [
        ("[", "SHAPE_CONCEPTS_STREAMS is no JSON"),
        ('[{"ky": "a"}]', "SHAPE_CONCEPTS_STREAMS, 0, key: Field required"),
    ],
)
def test_a_setting_in_json_is_told_with_the_place_of_its_fault(
    folder: Path, monkeypatch: pytest.MonkeyPatch, value: str, says: str
) -> None:
    monkeypatch.setenv("SHAPE_CONCEPTS_STREAMS", value)
    result = run("models", "list")
    assert (result.exit_code, says in result.stderr) == (2, True), result.stderr


def test_help_comes_without_loading_the_engine_or_the_server() -> None:
    code = (
        "import sys\nfrom service.cli import main\nmain(['respond', '--help'], standalone_mode=False)\n"
        "loaded = {'numba', 'numpy', 'fastapi', 'pydantic', 'rich', 'obstore'} & set(sys.modules)\n"
        "assert not loaded, loaded"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
