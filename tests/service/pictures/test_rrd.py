"""The recording that `respond --save` writes, read back by Rerun's own reader, and shown by its viewer."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from service.application import Application
from service.clouds import SceneCloud
from service.engine.cloud import PointCloud
from service.pictures.colours import parts
from service.pictures.picture import Picture, draw_cloud
from service.pictures.rrd import write_rrd
from tests.service.pictures.test_picture import learnt

reading = pytest.importorskip("rerun.chunk", reason="rerun-sdk is not installed: ./run test --all installs it")


@pytest.fixture
def pictures(application: Application, clouds: list[PointCloud]) -> list[Picture]:
    drawn = []
    for name, cloud in zip(("茶碗 [1] | é.ply", "box/2.ply"), clouds, strict=False):
        answer = application.respond(cloud, explain=True, segments=True)
        drawn.append(
            draw_cloud(
                name,
                SceneCloud(cloud),
                answer,
                lambda told: learnt(application, told),
                lambda number: application.looking.thumbnail("tiny", 1, number),
            )
        )
    return drawn


def test_what_was_drawn_is_read_back(pictures: list[Picture], tmp_path: Path) -> None:
    file = tmp_path / "two.rrd"
    write_rrd(pictures, file)
    entities = {chunk.entity_path: chunk.to_record_batch().to_pydict() for chunk in reading.RrdReader(file).stream()}
    for number, picture in enumerate(pictures):
        assert picture.answer is not None
        assert picture.answer.explanation is not None
        for colouring in picture.colourings:
            (points,), (colours,) = (
                entities[f"/{number}/by_{colouring.by}"][f"Points3D:{what}"] for what in ("positions", "colors")
            )
            np.testing.assert_array_equal(np.array(points, np.float32), picture.points)
            red, green, blue = parts(colouring.colours[colouring.values[0]])
            assert colours[0] == (red << 24) + (green << 16) + (blue << 8) + 255
        text = entities[f"/{number}/answer"]["TextDocument:text"][0][0]
        assert f"novelty {picture.answer.novelty:.2f}" in text
        assert all(f"concept {concept.id} |" in text for concept in picture.answer.concepts[:10])
        motifs = [path for path in entities if path.startswith(f"/{number}/motifs/")]
        assert len(motifs) == len(picture.answer.explanation.vertices)
        rows = [path for path in entities if path.startswith(f"/{number}/prototypes/")]
        assert len(rows) == len(picture.answer.explanation.concepts) + 1
        assert len(entities[f"/{number}/prototypes/0"]["Image:buffer"][0][0]) == 3 * 48 * 48


def test_reruns_own_program_finds_it_whole_and_told_where_all_is_shown(pictures: list[Picture], tmp_path: Path) -> None:
    file = tmp_path / "one.rrd"
    write_rrd(pictures[:1], file)
    said = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "verify", str(file)], capture_output=True, text=True, timeout=60
    )
    assert (said.returncode, "verified without error" in said.stdout + said.stderr) == (0, True)
    assert len(reading.RrdReader(file).blueprints()) == 1


def test_a_file_that_cannot_be_written_is_said_before_anything_is_drawn(
    pictures: list[Picture], tmp_path: Path
) -> None:
    with pytest.raises(OSError, match="missing"):
        write_rrd(pictures, tmp_path / "missing" / "x.rrd")


@pytest.mark.slow
def test_the_viewer_shows_it_whatever_the_clouds_are_called(pictures: list[Picture], tmp_path: Path) -> None:
    from rerun.experimental import ViewerClient

    write_rrd(pictures, tmp_path / "two.rrd")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "rerun", "--headless", "--bind", "127.0.0.1", "--port", str(port)]
    command += ["--window-size", "1400x900", "--renderer", "vulkan", str(tmp_path / "two.rrd")]
    colouring = pictures[0].colourings[0]
    wanted = np.array(parts(colouring.colours[0]))
    with (tmp_path / "log").open("w") as log:
        viewer = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True)
    try:
        until, most = time.monotonic() + 60, 0
        while most < 1000 and time.monotonic() < until:
            time.sleep(1)
            if viewer.poll() is not None:
                said = (tmp_path / "log").read_text()
                if "panicked" not in said:
                    pytest.skip(f"no Vulkan driver for the viewer: {said[-300:]}")
                pytest.fail(said[-3000:])
            try:
                ViewerClient(f"rerun+http://127.0.0.1:{port}/proxy").save_screenshot(str(tmp_path / "shot.png"))
            except (ConnectionError, RuntimeError):
                continue  # it starts
            if (tmp_path / "shot.png").exists():
                image = np.array(Image.open(tmp_path / "shot.png").convert("RGB")).astype(float)
                length = np.linalg.norm(image, axis=2)
                most = int(((image @ wanted > 0.99 * length * np.linalg.norm(wanted)) & (length > 60)).sum())
        assert most >= 1000, (tmp_path / "log").read_text()[-2000:]
    finally:
        with suppress(ProcessLookupError):  # the program that was started is but the parent of the viewer
            os.killpg(viewer.pid, signal.SIGTERM)
        viewer.wait(30)
