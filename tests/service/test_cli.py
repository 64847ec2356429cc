"""The command line: what it prints, on which stream, and with which exit code."""

from __future__ import annotations

import glob
import json
import re
import shlex
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest
from click.testing import CliRunner, Result

from service.archives import write
from service.cli import main
from service.clouds import write_ply
from service.engine.cloud import PointCloud
from service.engine.model import ShapeModel
from service.model_file import encode
from service.settings import Settings
from service.store import ModelStore
from tests.service.clouds.written import npy, png
from tests.service.tabletop.seen import set_table
from tests.service.test_archives import NOW
from tests.service.test_datasets import ply
from worker.cli import main as worker


@pytest.fixture
def folder(tmp_path: Path, settings: Settings, clouds: list[PointCloud], monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, with a cloud and a file that is none; the environment names the store."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SHAPE_CONCEPTS_STORE", settings.store)
    monkeypatch.setenv("SHAPE_CONCEPTS_JOBS_URL", f"sqlite:///{tmp_path / 'jobs.sqlite'}")
    monkeypatch.setenv("COLUMNS", "120")
    (tmp_path / "good.ply").write_bytes(write_ply(clouds[0]))
    (tmp_path / "bad.ply").write_bytes(b"ply\nformat ascii 1.0\n")
    return tmp_path


def run(*arguments: str, stdin: bytes | None = None) -> Result:
    return CliRunner().invoke(main, arguments, input=stdin)


def lines(result: Result) -> list[dict[str, Any]]:
    return [json.loads(line) for line in result.stdout.splitlines()]


def test_a_schedule_is_made_looked_at_paused_and_removed(folder: Path) -> None:
    assert run("schedules", "list", "--json").stdout == '{"schedules": []}\n'
    assert not (folder / "jobs.sqlite").exists()
    times = ("weekly", "--cron", "0 3 * * mon", "--zone", "Europe/Berlin")
    for _ in range(2):
        made = run("schedules", "create", *times, "--job", '{"name": "toys", "simulate": 2}')
        assert made.exit_code == 0, made.output
        assert "Schedule weekly is active; next due" in made.stdout
    (shown,) = lines(run("schedules", "show", "weekly", "--json"))
    assert (shown["cron"], shown["zone"], shown["job"]["simulate"]) == ("0 3 * * mon", "Europe/Berlin", 2)
    assert lines(run("schedules", "list", "--json"))[0]["schedules"] == [shown]
    assert "weekly" in run("schedules", "list").stdout
    assert "simulate" in run("schedules", "show", "weekly").stdout
    assert lines(run("schedules", "pause", "weekly", "--json"))[0]["next_due"] is None
    assert "active" in run("schedules", "resume", "weekly").stdout
    assert run("schedules", "delete", "weekly").exit_code == 0
    refused = run("schedules", "show", "weekly")
    assert (refused.exit_code, "There is no schedule 'weekly'" in refused.stderr) == (1, True)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--cron", "soon", "--job", '{"name": "toys", "simulate": 2}'), "no cron expression"),
        (("--cron", "0 3 * * mon", "--job", "[1]"), "No such file"),
        (("--cron", "0 3 * * mon", "--job", "{"), "no JSON"),
        (("--cron", "0 3 * * mon", "--job", '{"name": "toys"}'), "at least one of"),
        (("--cron", "0 3 * * mon", "--job", '{"name": "toys", "extend": "nobody"}'), "There is no 'nobody@production'"),
    ],
)
def test_a_schedule_that_cannot_be_says_why(folder: Path, arguments: tuple[str, ...], said: str) -> None:
    refused = run("schedules", "create", "weekly", *arguments)
    assert refused.exit_code == 1
    assert said in refused.stderr


def test_versions_are_compared(folder: Path, store: ModelStore, model: ShapeModel) -> None:
    store.publish(model, name="tiny", seed=7, source={}, alias="staging")
    (told,) = lines(run("models", "compare", "tiny", "tiny@staging", "--json"))
    assert [(told[which]["model"], told[which]["version"]) for which in ("old", "new")] == [("tiny", 1), ("tiny", 2)]
    assert told["fates"] == {"persists": len(model.concepts().ids)}
    shown = run("models", "compare", "tiny:1", "tiny:2")
    assert shown.exit_code == 0
    assert "persists" in shown.stdout
    assert run("models", "compare", "tiny:1", "tiny:3").exit_code == 1


def test_respond_prints_one_json_line_a_cloud(folder: Path, model: ShapeModel, clouds: list[PointCloud]) -> None:
    result = run("respond", "--model", "tiny", "--json", "good.ply", "good.ply")
    assert result.exit_code == 0
    first, second = lines(result)
    response = model.respond(clouds[0])
    assert list(first)[:3] == ["file", "model", "version"]
    assert (first["file"], first["model"], first["version"]) == ("good.ply", "tiny", 1)
    assert first["responses"] == second["responses"] == response.responses.tolist()
    assert first["distances"] == response.distances.tolist()
    assert set(first["concepts"][0]) == {"id", "name", "response", "distance", "rank", "prototypes", "time"}
    assert (first["segments"], first["extent_m"], first["truncated"]) == (
        response.segments,
        response.extent_m,
        response.truncated,
    )
    assert set(first["timings_ms"]) >= {"decode", "responses"}
    assert "stimuli" not in first


def test_options_of_respond_reach_the_engine(folder: Path, clouds: list[PointCloud]) -> None:
    Path("mm.ply").write_bytes(write_ply(PointCloud((clouds[0].points * 1000).astype(np.float32))))
    (answer,) = lines(run("respond", "--json", "--time", "1", "--top", "1", "--stimuli", "--unit", "mm", "mm.ply"))
    assert answer["time"] == 1
    assert len(answer["concepts"]) == 1
    assert len(answer["stimuli"]["index"]) == len(answer["stimuli"]["value"]) > 0
    assert answer["extent_m"] < 1
    behind = lines(run("respond", "--json", "--viewpoint", "0,0,9", "good.ply"))[0]
    assert any("viewpoint" in warning for warning in behind["warnings"])


def test_an_answer_can_be_explained_to_programs_and_people(folder: Path, clouds: list[PointCloud]) -> None:
    (answer,) = lines(run("respond", "--json", "--explain", "--segments", "good.ply"))
    assert set(answer["explanation"]) == {"segments", "vertices", "concepts", "wholes", "thumbnails"}
    assert len(answer["point_segments"]) == len(clouds[0].points)
    assert len(answer["explanation"]["segments"]) == answer["segments"] == max(answer["point_segments"]) + 1
    said = run("respond", "--explain", "good.ply").stdout
    assert "novelty 0.00" in " ".join(said.split())
    for near in (answer["explanation"]["wholes"][0], answer["explanation"]["concepts"][0]["nearest"][0]):
        assert f"{near['key']} {near['distance']:.3f}" in said
    for fired in answer["explanation"]["vertices"]:
        assert f"{fired['stimulus']:.3f}" in said
    pictures = [line for line in said.splitlines() if line.startswith("│") and set(line) & set("%@#")]
    assert len(pictures) > 10
    assert "explanation" not in lines(run("respond", "--json", "good.ply"))[0]


def test_the_objects_of_a_scene_are_answered_to_programs_and_people(folder: Path) -> None:
    Path("table.ply").write_bytes(write_ply(set_table("kinect").cloud))
    result = run("respond", "--scene", "--json", "--top", "1", "table.ply", "bad.ply", "table.ply")
    assert result.exit_code == 1
    first, bad, second = lines(result)
    assert bad["error"]["type"] == "unreadable-cloud"
    assert list(first)[:3] == ["file", "model", "version"]
    assert first["objects"][0]["answer"]["responses"] == second["objects"][0]["answer"]["responses"]
    assert len(first["objects"]) == 3
    said = run("respond", "--scene", "--explain", "--top", "1", "table.ply").stdout
    assert "3 objects" in said
    for one in first["objects"]:
        assert f"object {one['number']}" in said
        assert ", ".join(f"{metres:.3f}" for metres in one["position_m"]) in said
        assert f"{one['answer']['concepts'][0]['response']:.3f}" in said
    for left in first["left_out"]:
        assert left["detail"] in said
    assert "motif vertices" in said


def test_answers_are_drawn_into_files_and_printed_as_without(folder: Path) -> None:
    plain = lines(run("respond", "--model", "tiny", "--json", "good.ply"))
    drawn = run("respond", "--model", "tiny", "--json", "--html", "two.html", "good.ply", "good.ply")
    assert drawn.exit_code == 0, drawn.output
    assert "Wrote two.html" in drawn.stderr
    assert [set(line) for line in lines(drawn)] == [set(plain[0])] * 2
    assert lines(drawn)[0]["responses"] == plain[0]["responses"]
    assert Path("two.html").read_text().count('"title": "good.ply"') == 2
    assert [file.name for file in folder.glob(".two*")] == []


def test_answers_are_recorded_for_reruns_viewer(folder: Path) -> None:
    pytest.importorskip("rerun", reason="rerun-sdk is not installed: ./run test --all installs it")
    recorded = run("respond", "--model", "tiny", "--json", "--save", "two.rrd", "good.ply", "good.ply")
    assert recorded.exit_code == 0, recorded.output
    assert "Wrote two.rrd" in recorded.stderr
    assert Path("two.rrd").read_bytes()[:2] == b"RR"
    assert [file.name for file in folder.glob(".two*")] == []


def test_the_objects_of_a_scene_are_drawn(folder: Path) -> None:
    Path("table.pcd").write_bytes(write_ply(set_table().cloud))
    result = run("respond", "--model", "tiny", "--json", "--scene", "--html", "table.html", "table.pcd")
    assert result.exit_code == 0, result.output
    (told,) = lines(result)
    assert "point_objects" not in told
    assert not any({"explanation", "point_segments"} & set(one["answer"]) for one in told["objects"])
    titles = re.findall(r'"title": "([^"]*)"', Path("table.html").read_text())
    assert titles == ["table.pcd", *(f"table.pcd, object {one['number']}" for one in told["objects"])]


def test_what_could_not_be_answered_is_not_drawn_and_keeps_no_other_from_it(folder: Path) -> None:
    result = run("respond", "--model", "tiny", "--html", "one.html", "bad.ply", "good.ply")
    assert result.exit_code == 1
    assert Path("one.html").read_text().count('"title": ') == 1
    assert run("respond", "--model", "tiny", "--html", "none.html", "bad.ply").exit_code == 1
    assert not Path("none.html").exists()


def test_without_rerun_it_is_said_what_to_install_before_any_answer(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    result = run("respond", "--model", "tiny", "--save", "one.rrd", "good.ply")
    assert (result.exit_code, result.stdout) == (1, "")
    assert "pip install 'shape-concepts[rerun]'" in result.stderr
    assert "--html" in result.stderr


def test_a_bad_cloud_keeps_no_other_from_its_answer(folder: Path) -> None:
    result = run("respond", "--json", "bad.ply", "missing.ply", ".", "good.ply")
    assert result.exit_code == 1
    bad, missing, directory, good = lines(result)
    for line in (bad, missing, directory):
        assert set(line) == {"file", "error"}
        assert set(line["error"]) == {"type", "detail"}
        assert line["error"]["type"] == "unreadable-cloud"
    assert good["responses"]


@pytest.mark.parametrize(
    ("arguments", "kind"),
    [
        (["--model", "nobody"], "model-not-found"),
        (["--model", "No Body"], "invalid-parameter"),
        (["--store", "nothing"], "model-not-found"),
        (["--store", "good.ply"], "store-unavailable"),
        (["--store", "ftp://x"], "store-unavailable"),
    ],
)
def test_without_a_model_each_cloud_has_its_line_of_json(
    folder: Path, arguments: list[str], kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SHAPE_CONCEPTS_BUILT_IN", "false")
    result = run("respond", "--json", "good.ply", "bad.ply", *arguments)
    assert result.exit_code == 1
    first, second = lines(result)
    assert (first["file"], second["file"]) == ("good.ply", "bad.ply")
    assert set(first) == {"file", "error"}
    assert first["error"] == second["error"]
    assert first["error"]["type"] == kind
    assert first["error"]["detail"]


def test_for_people_results_are_a_table_and_errors_a_line_on_stderr(folder: Path) -> None:
    result = run("respond", "bad.ply", "good.ply", "--top", "1")
    assert result.exit_code == 1
    assert "prototypes" in result.stdout
    assert " cm across" in result.stdout
    assert "bad.ply" not in result.stdout
    (line,) = result.stderr.splitlines()
    assert line.startswith("Error: bad.ply: ")


def test_a_table_lists_a_few_concepts_unless_more_are_asked_for(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    few = 1  # so small a model has no more concepts than a table lists
    monkeypatch.setattr("service.commands.respond.TOP", few)
    (whole,) = lines(run("respond", "--json", "good.ply"))
    count = len(whole["concepts"])
    assert count == len(whole["responses"]) > few
    for arguments, listed in (((), few), (("--top", "2"), 2), (("--top", "999"), count)):
        table = run("respond", *arguments, "good.ply").stdout
        rows = re.findall(r"^│ +(\d+) │ +(\d+) │", table, re.MULTILINE)
        assert rows == [(str(each["rank"]), str(each["id"])) for each in whole["concepts"][:listed]]
        assert (f"the first {listed} of {count} concepts" in table) == (listed < count)


def test_a_depth_image_is_answered_with_its_camera_and_mask(folder: Path) -> None:
    depth = np.full((60, 80), 1500, np.uint16)
    rows, columns = np.indices(depth.shape)
    seen = (abs(rows - 30) < 20) & (abs(columns - 40) < 30)
    depth[seen] = 700 + 3 * abs(columns - 40)[seen] + abs(rows - 30)[seen]
    Path("depth.png").write_bytes(png(depth))
    Path("mask.png").write_bytes(png(seen * np.uint8(255)))
    z = np.where(seen, depth * 0.001, np.nan)
    Path("points.npy").write_bytes(npy(np.dstack([(columns - 40) * z / 200, (rows - 30) * z / 200, z])))
    (expected,) = lines(run("respond", "--json", "--segments", "points.npy"))
    camera = ("--intrinsics", "200,200,40,30", "--mask", "mask.png", "--json", "--segments")
    for arguments in (("depth.png",), ("--depth-scale", "0.001", "depth.png")):
        (answer,) = lines(run("respond", *camera, *arguments))
        unlike = {"file", "timings_ms"}
        assert {k: v for k, v in answer.items() if k not in unlike} == {
            k: v for k, v in expected.items() if k not in unlike
        }
    (refused,) = lines(run("respond", "--json", "depth.png"))
    assert refused["error"]["type"] == "invalid-parameter"


def test_a_cloud_may_come_from_standard_input(folder: Path) -> None:
    result = run("respond", "--json", "-", stdin=Path("good.ply").read_bytes())
    assert lines(result)[0]["file"] == "-"
    assert result.exit_code == 0


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


def test_models_can_be_listed_shown_promoted_and_rolled_back(
    folder: Path, store: ModelStore, model: ShapeModel
) -> None:
    store.publish(model, name="tiny", seed=7, source={}, alias=None)
    assert lines(run("models", "list", "--json")) == [
        {"models": [{"name": "tiny", "versions": [1, 2], "aliases": {"production": 1}, "built_in": False}]}
    ]
    assert lines(run("models", "promote", "tiny:2", "--json")) == [
        {"model": "tiny", "version": 2, "alias": "production"}
    ]
    (shown,) = lines(run("models", "show", "tiny", "--json"))
    assert (shown["version"], shown["seed"]) == (2, 7)
    assert [entry["version"] for entry in shown["aliases"]["production"]] == [1, 2]
    assert lines(run("models", "rollback", "tiny", "--json"))[0]["version"] == 1
    assert lines(run("models", "promote", "tiny:2", "--alias", "staging", "--json"))[0]["alias"] == "staging"
    assert lines(run("models", "promote", "tiny@staging", "--json"))[0]["version"] == 2
    for command in (["list"], ["show", "tiny"]):
        result = run("models", *command)
        assert result.exit_code == 0
        assert "tiny" in result.stdout


def test_an_export_is_the_stored_model(folder: Path, store: ModelStore, model: ShapeModel) -> None:
    (result,) = lines(run("models", "export", "tiny", "--out", "deep/exported", "--json"))
    assert result["files"] == ["deep/exported/manifest.json", "deep/exported/model.safetensors"]
    assert Path("deep/exported/model.safetensors").read_bytes() == encode(model)
    assert json.loads(Path("deep/exported/manifest.json").read_text())["name"] == "tiny"


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


def test_a_store_without_a_model_is_told_where_one_was_named(folder: Path) -> None:
    named = run("respond", "--store", "elsewhere", "--json", "good.ply")
    assert (named.exit_code, "elsewhere holds no model" in named.stderr) == (0, True)
    assert "holds no model" not in run("respond", "--model", "tiny", "--json", "good.ply").stderr


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


class TestNames:
    def test_a_name_is_given_listed_told_and_taken_away(self, folder: Path, model: ShapeModel) -> None:
        concept = int(model.concepts().ids[0])
        (given,) = lines(run("names", "set", "tiny", str(concept), " tea mug ", "--json"))
        assert given == {"model": "tiny", "version": 1, "concept": concept, "name": "tea mug"}
        assert "tea mug" in run("names", "list", "tiny").stdout
        (listed,) = lines(run("names", "list", "tiny:1", "--json"))
        assert listed["names"] == [{"concept": concept, "name": "tea mug", "carried_from": None}]
        (answer,) = lines(run("respond", "--json", "good.ply"))
        assert {c["id"]: c["name"] for c in answer["concepts"]}[concept] == "tea mug"
        assert f"Concept {concept} of tiny:1 has no name now" in run("names", "remove", "tiny", str(concept)).stdout
        assert lines(run("names", "list", "tiny", "--json"))[0]["names"] == []

    def test_names_are_carried_over_once_and_say_so(self, folder: Path, store: ModelStore, model: ShapeModel) -> None:
        store.publish(model, name="tiny", seed=7, source={}, alias="staging")
        concept = int(model.concepts().ids[0])
        run("names", "set", "tiny:1", str(concept), "mug")
        for _ in range(2):
            (carried,) = lines(run("names", "carry", "tiny:2", "--from", "tiny:1", "--json"))
            assert (carried["version"], carried["carried_from"]) == (2, "tiny:1")
            assert carried["names"] == [{"concept": concept, "name": "mug", "before": concept, "jaccard": 1}]
        assert "mug" in run("names", "carry", "tiny@staging", "--from", "tiny").stdout
        assert "tiny:1" in run("names", "list", "tiny:2").stdout
        assert "say another version" in run("names", "carry", "tiny:1", "--from", "tiny").stderr

    def test_names_are_proposed_from_labels_and_given_when_asked(self, folder: Path) -> None:
        (folder / "labels.csv").write_text("file,category\ngood.ply,mug\nbad.ply,bowl\nnowhere.ply,bowl\n")
        result = run("names", "propose", "tiny", "--labels", "labels.csv", "--json")
        assert result.exit_code == 1
        (proposed,) = lines(result)
        assert [entry["name"] for entry in proposed["proposals"]] == ["mug"]
        assert [entry["file"] for entry in proposed["left_out"]] == ["bad.ply", "nowhere.ply"]
        assert lines(run("names", "list", "tiny", "--json"))[0]["names"] == []
        (folder / "labels.csv").write_text("file,category,fine\ngood.ply,mug,x\n")
        result = run("names", "propose", "tiny", "--labels", "labels.csv", "--apply")
        assert (result.exit_code, "mug 1" in result.stdout) == (0, True)
        assert [entry["name"] for entry in lines(run("names", "list", "tiny", "--json"))[0]["names"]] == ["mug"]

    @pytest.mark.parametrize(
        ("arguments", "code", "said"),
        [
            (["set", "tiny", "3", "mug"], 1, "no concept 3"),
            (["set", "tiny", "14", "a\tb"], 1, "visible characters"),
            (["set", "nobody", "14", "mug"], 1, "nobody"),
            (["set", "tiny", "x", "mug"], 2, "CONCEPT"),
            (["propose", "tiny", "--labels", "good.ply"], 1, "good.ply"),
            (["propose", "tiny", "--labels", "bad.ply"], 1, "columns file and category"),
            (["propose", "tiny", "--labels", "nowhere.csv"], 1, "nowhere.csv"),
        ],
    )
    def test_what_is_wrong_is_said(self, folder: Path, arguments: list[str], code: int, said: str) -> None:
        result = run("names", *arguments)
        assert (result.exit_code, said in result.stderr) == (code, True), result.stderr


def test_a_key_is_shown_once_and_its_secret_in_no_list(folder: Path) -> None:
    made = run("keys", "create", "robot-7", "--scope", "answer", "--scope", "train", "--rate", "5")
    assert made.exit_code == 0
    text = made.stdout.strip()
    assert re.fullmatch(r"sc_[0-9a-f]{12}_[A-Za-z0-9_-]{43}", text)
    (key,) = json.loads(run("keys", "list", "--json").stdout)["keys"]
    assert (key["name"], key["scopes"], key["rate"], key["revoked"]) == ("robot-7", ["answer", "train"], 5, False)
    assert run("keys", "revoke", key["id"]).exit_code == 0
    listed = run("keys", "list")
    assert "revoked" in listed.stdout
    assert text.split("_", 2)[2] not in listed.stdout + json.dumps(key)


def test_the_limits_of_a_key_are_told(folder: Path) -> None:
    made = run("keys", "create", "cameras", "--max-body", "4000000", "--max-points", "300000", "--max-batch", "8")
    assert made.exit_code == 0
    (key,) = json.loads(run("keys", "list", "--json").stdout)["keys"]
    assert (key["max_body"], key["max_points"], key["max_batch"]) == (4_000_000, 300_000, 8)
    listed = " ".join(run("keys", "list").stdout.replace("│", " ").split())
    for limit in ("4000000", "300000", "8"):
        assert limit in listed
    refused = run("keys", "create", "cameras", "--max-points", "3")
    assert refused.exit_code != 0
    assert "max_points" in refused.stderr


def test_a_key_that_is_not_there_cannot_be_revoked(folder: Path) -> None:
    result = run("keys", "revoke", "0123456789ab")
    assert result.exit_code == 1
    assert "keys list" in result.stderr


class TestDatasets:
    @pytest.fixture(autouse=True)
    def mugs(self, folder: Path) -> None:
        """A folder of clouds, and an empty dataset."""
        for seed, file in enumerate(("a.ply", "deep/b.ply", "torn.ply", "notes.md", "sheet.png", ".hidden.ply")):
            (folder / "scans" / file).parent.mkdir(parents=True, exist_ok=True)
            (folder / "scans" / file).write_bytes(ply(seed)[: -9 if file == "torn.ply" else None])
        (folder / "scans" / "labels.csv").write_text("file,category\na.ply,mug\ndeep/b.ply,bowl\n")
        assert run("datasets", "create", "mugs", "--description", "some").exit_code == 0

    def test_a_folder_goes_in_and_an_archive_comes_out_that_makes_the_same_dataset(self) -> None:
        added = run("datasets", "add", "mugs", "scans", "--json")
        assert added.exit_code == 1
        assert {line["key"]: line["outcome"] for line in lines(added)} == {
            "a.ply": "accepted",
            "deep/b.ply": "accepted",
            "torn.ply": "refused",
            "notes.md": "left-out",
            "sheet.png": "left-out",
            ".hidden.ply": "left-out",
            "labels.csv": "accepted",
        }
        again = run("datasets", "add", "mugs", "scans")
        assert "2 already-there" in again.stdout
        assert again.stderr.startswith("Error: torn.ply: ")
        run("datasets", "create", "copy")
        (shown,) = lines(run("datasets", "show", "mugs", "--json"))
        assert [entry["key"] for entry in shown["listed"]] == ["a.ply", "deep/b.ply"]
        for out in ("mugs.zip", "mugs.tar.gz"):
            assert run("datasets", "download", "mugs", "--out", out).exit_code == 0
            assert run("datasets", "add", "copy", out).exit_code == 0
        (copy,) = lines(run("datasets", "show", "copy", "--json"))
        assert [copy[part] for part in ("digest", "categories")] == [shown[part] for part in ("digest", "categories")]
        (listed,) = lines(run("datasets", "list", "--json"))
        assert [held["name"] for held in listed["datasets"]] == ["copy", "mugs"]
        for command in (["list"], ["show", "mugs"], ["show", "mugs", "--limit", "0"]):
            assert "mugs" in run("datasets", *command).stdout

    def test_files_are_added_by_their_names_and_come_back_byte_for_byte(self) -> None:
        assert run("datasets", "add", "mugs", "scans/a.ply", "scans/deep/b.ply").exit_code == 0
        clash = run("datasets", "add", "mugs", "good.ply", "scans/torn.ply", "--json")
        assert [(line["key"], line["outcome"]) for line in lines(clash)] == [
            ("good.ply", "accepted"),
            ("torn.ply", "refused"),
        ]
        shutil.copy("good.ply", "a.ply")
        assert "another cloud 'a.ply'" in run("datasets", "add", "mugs", "a.ply").stderr
        assert "1 replaced" in run("datasets", "add", "mugs", "a.ply", "--replace").stdout
        assert run("datasets", "download", "mugs", "--key", "a.ply", "--out", "back.ply").exit_code == 0
        assert Path("back.ply").read_bytes() == Path("good.ply").read_bytes()

    def test_labels_are_printed_and_taken(self) -> None:
        run("datasets", "add", "mugs", "scans/a.ply")
        Path("more.csv").write_text("file,category\na.ply,cup\nnobody.ply,mug\n")
        taken = run("datasets", "labels", "mugs", "--add", "more.csv", "--json")
        assert (taken.exit_code, "nobody.ply" in taken.stderr) == (1, True)
        assert run("datasets", "labels", "mugs").stdout.splitlines()[1].startswith("a.ply,cup,")
        assert lines(run("datasets", "labels", "mugs", "--json"))[0]["labels"]["a.ply"]["category"] == "cup"

    def test_what_a_model_learnt_from_is_deleted_by_force_only(self, store: ModelStore, model: ShapeModel) -> None:
        run("datasets", "add", "mugs", "scans/a.ply")
        source = {"kind": "dataset", "name": "mugs", "digest": "0", "clouds": 1}
        store.publish(model, name="m", seed=1, source=source)
        refused = run("datasets", "delete", "mugs")
        assert (refused.exit_code, "m:1" in refused.stderr, "--force" in refused.stderr) == (1, True, True)
        assert run("datasets", "delete", "mugs", "--force").exit_code == 0
        assert run("datasets", "show", "mugs").exit_code == 1

    @pytest.mark.parametrize(
        ("arguments", "code", "said"),
        [
            (["create", "Mugs"], 1, "lower-case"),
            (["create", "mugs", "--description", "others"], 1, "some"),
            (["add", "nobody", "scans"], 1, "nobody"),
            (["add", "mugs", "nowhere"], 2, "nowhere"),
            (["add", "mugs", "scans", "--unit", "furlong"], 2, "--unit"),
            (["download", "mugs", "--out", "mugs.rar"], 2, "--out"),
            (["download", "mugs", "--out", "x.ply", "--key", "x"], 1, "no cloud"),
            (["labels", "mugs", "--add", "good.ply"], 1, "comma-separated"),
            (["record", "mugs", "--key", "a/b"], 2, "--connect"),
            (["record", "mugs", "--key", "a//b", "--connect", "tcp/127.0.0.1:1"], 1, "a//b"),
            (["record", "nobody", "--key", "a/b", "--connect", "tcp/127.0.0.1:1"], 1, "nobody"),
            (["record", "mugs", "--key", "a/b", "--connect", "tcp/127.0.0.1:1"], 1, "Unable to connect"),
            (["record", "mugs", "--key", "a/b", "--format", "stl"], 2, "--format"),
        ],
    )
    def test_what_is_wrong_is_said(self, arguments: list[str], code: int, said: str) -> None:
        result = run("datasets", *arguments)
        assert (result.exit_code, said in result.stderr) == (code, True), result.output
        assert "Traceback" not in result.stderr
        assert not list(Path().glob("*.part"))
