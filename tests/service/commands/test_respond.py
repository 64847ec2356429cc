"""`shape-concepts respond`: files, scenes and depth images, for programs and for people."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from service.clouds import write_ply
from service.engine.cloud import PointCloud
from service.engine.model import ShapeModel
from tests.service.clouds.written import npy, png
from tests.service.commands.asked import lines, run
from tests.service.tabletop.seen import set_table


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


def test_a_store_without_a_model_is_told_where_one_was_named(folder: Path) -> None:
    named = run("respond", "--store", "elsewhere", "--json", "good.ply")
    assert (named.exit_code, "elsewhere holds no model" in named.stderr) == (0, True)
    assert "holds no model" not in run("respond", "--model", "tiny", "--json", "good.ply").stderr
