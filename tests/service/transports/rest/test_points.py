"""POST /v1/points: any cloud, as points to draw."""

from __future__ import annotations

import re

import httpx
import numpy as np
import pytest

from service import clouds as formats
from service.clouds import write_ply
from service.engine.cloud import PointCloud
from tests.service.clouds.written import every_kind, npy, png, some_points

ROWS = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("index", "<i4")])


def drawn(answer: httpx.Response) -> tuple[np.ndarray, np.ndarray, dict[str, list[float]]]:
    """Points (V, 3), their places in the file (V,), and the numbers that the header's comments tell."""
    assert (answer.status_code, answer.headers["content-type"]) == (200, "model/ply")
    header, _, body = answer.content.partition(b"end_header\n")
    rows = np.frombuffer(body, ROWS)
    assert f"element vertex {len(rows)}\n" in header.decode()
    said = re.findall(r"comment (measured|file|viewpoint) (.+)\n", header.decode())
    points = np.stack([rows["x"], rows["y"], rows["z"]], axis=1)
    return points, rows["index"], {word: [float(number) for number in numbers.split()] for word, numbers in said}


def test_all_points_of_a_small_cloud_come_back_each_with_its_place(
    client: httpx.Client, clouds: list[PointCloud]
) -> None:
    points, places, said = drawn(client.post("/v1/points", content=write_ply(clouds[0])))
    assert sorted(places) == list(range(len(clouds[0].points)))
    assert np.array_equal(points, clouds[0].points[places])
    assert said["measured"] == said["file"] == [len(clouds[0].points)]
    assert said["viewpoint"] == [0, 0, 0, 1, 0, 0, 0]


def test_of_more_points_an_even_sample_is_sent_and_every_beginning_of_it_is_one(client: httpx.Client) -> None:
    line = np.zeros((20_000, 3), np.float32)
    line[:, 0] = np.linspace(0, 1, len(line))
    line[:, 2] = 1
    points, places, said = drawn(client.post("/v1/points", params={"most": 4000}, content=npy(line)))
    assert (len(points), said["file"]) == (4000, [20_000])
    assert len(set(places.tolist())) == 4000
    for beginning in (points, points[:400]):
        shares = np.histogram(beginning[:, 0], bins=4, range=(0, 1))[0] / len(beginning)
        assert np.abs(shares - 0.25).max() < 0.08  # 3 standard deviations of 400 draws


@pytest.mark.parametrize("kind", every_kind(some_points()))
def test_every_format_is_drawn(client: httpx.Client, kind: str) -> None:
    points = some_points()
    seen, places, _ = drawn(client.post("/v1/points", content=every_kind(points)[kind]))
    assert np.allclose(seen, points[places], atol=1e-6)


def test_what_was_not_measured_is_not_drawn_and_places_are_those_of_the_file(client: httpx.Client) -> None:
    grid = np.full((10, 12, 3), np.nan, np.float32)
    grid[2:8, 3:9] = np.random.default_rng(0).uniform(0.5, 1, (6, 6, 3))
    points, places, said = drawn(client.post("/v1/points", content=npy(grid)))
    assert said["measured"], said["file"] == ([36], [120])
    assert np.array_equal(points, grid.reshape(-1, 3)[places])


def test_segments_of_an_answer_go_by_these_places(client: httpx.Client, clouds: list[PointCloud]) -> None:
    file = write_ply(clouds[1])
    answer = client.post("/v1/responses", params={"detail": "segments"}, content=file).json()
    _, places, _ = drawn(client.post("/v1/points", content=file))
    seen = np.array(answer["point_segments"])[places]
    assert set(seen.tolist()) <= set(range(-1, answer["segments"]))
    assert np.count_nonzero(seen >= 0) > 0.9 * len(seen)


def test_points_come_in_metres_and_the_sensors_frame_with_the_pose_it_had(client: httpx.Client) -> None:
    own = np.array([[100, 0, 0], [100, 10, 0], [100, 0, 10]], np.float32)
    query = {"unit": "cm", "viewpoint": "0,0,20,0.5,-0.5,0.5,-0.5"}
    points, places, said = drawn(client.post("/v1/points", params=query, content=npy(own)))
    expected = formats.read(npy(own), unit="cm", viewpoint=formats.Viewpoint((0, 0, 20), (0.5, -0.5, 0.5, -0.5)))
    assert np.allclose(points, expected.points[places])
    assert np.allclose(said["viewpoint"], [0, 0, 0.2, 0.5, -0.5, 0.5, -0.5])


def test_a_depth_image_is_drawn_by_its_camera(client: httpx.Client) -> None:
    depth = np.zeros((24, 32), np.uint16)
    depth[5:15, 5:15] = 800
    query = {"intrinsics": "30,30,15.5,11.5"}
    points, _, said = drawn(client.post("/v1/points", params=query, content=png(depth)))
    assert (len(points), said["file"]) == (100, [24 * 32])
    assert np.allclose(points[:, 2], 0.8)


@pytest.mark.parametrize(
    ("content", "query", "status", "kind"),
    [
        (b"no cloud at all", {}, 415, "unsupported-format"),
        (b"ply\nformat ascii 1.0\n", {}, 400, "unreadable-cloud"),
        (b"1 2 3\n", {"most": 0}, 422, "invalid-parameter"),
        (b"1 2 3\n", {"most": 10**9}, 422, "invalid-parameter"),
        (b"1 2 3\n", {"model": "tiny"}, 422, "invalid-parameter"),
        (b"1 2 3\n" * 2**18, {}, 413, "content-too-large"),
    ],
)
def test_what_cannot_be_drawn_is_refused_as_it_would_be_for_an_answer(
    client: httpx.Client, content: bytes, query: dict[str, str], status: int, kind: str
) -> None:
    refused = client.post("/v1/points", params=query, content=content)
    assert (refused.status_code, refused.json()["type"]) == (status, f"urn:shape-concepts:error:{kind}")


def test_a_key_that_may_answer_is_needed(guarded: httpx.Client) -> None:
    assert guarded.post("/v1/points", content=b"1 2 3\n").status_code == 401
