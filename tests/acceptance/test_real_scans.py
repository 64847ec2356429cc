"""Real depth-camera scans, as files, through a model that has only seen simulated objects."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import open3d
import pytest

from service import clouds
from service.engine.cloud import PointCloud
from tests.learnt import learnt
from tests.service.clouds.written import npy, png

EVERY = 12  # of each set
TABLE = 1  # its label in the scenes

pytestmark = pytest.mark.data


@pytest.fixture(params=["scans", "occluded", "rendered"])
def files(request: pytest.FixtureRequest, scans: Path) -> list[Path]:
    folder = scans / request.param
    with (folder / "labels.csv").open() as table:
        return [folder / row["file"] for row in csv.DictReader(table)][::EVERY]


def test_every_scan_is_answered_the_same_whatever_the_order_of_its_points(files: list[Path]) -> None:
    for file in files:
        cloud = clouds.read(file.read_bytes())
        answer = learnt().respond(cloud)
        shuffled = learnt().respond(PointCloud(np.random.default_rng(0).permutation(cloud.points)))
        assert np.isfinite(answer.responses).all(), file
        assert answer.responses.tobytes() == shuffled.responses.tobytes(), file
        assert answer.warnings == ()
        assert 0.02 < answer.extent_m < 0.6, file


def test_household_objects_have_a_few_segments(files: list[Path]) -> None:
    counts = [learnt().respond(clouds.read(file.read_bytes())).segments for file in files]
    assert np.median(counts) in (2, 3)
    assert max(counts) <= 12


def test_a_scan_turned_about_the_optical_axis_has_the_same_best_concept(files: list[Path]) -> None:
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]], dtype=np.float32)
    same = []
    for file in files:
        cloud = clouds.read(file.read_bytes())
        answers = [learnt().respond(PointCloud(points)) for points in (cloud.points, cloud.points @ turn.T)]
        same.append(answers[0].ranking[0] == answers[1].ranking[0])
    assert np.mean(same) >= 0.9


def test_objects_cut_out_of_depth_images_by_their_masks_are_answered_as_their_points(scans: Path) -> None:
    """The labels of a real scene are the masks; depths are whole millimetres, as a driver sends them."""
    camera = clouds.DepthCamera(525, 525, 319.5, 239.5)
    columns, rows = np.arange(640), np.arange(480)[:, None]
    answered = 0
    for file in sorted((scans / "scenes").glob("*.pcd"))[::4]:
        scene = open3d.t.io.read_point_cloud(str(file)).point
        millimetres = np.nan_to_num(scene.positions.numpy()[:, 2].reshape(480, 640) * 1000).round().astype(np.uint16)
        labels = scene["label"].numpy().reshape(480, 640)
        for label in set(np.unique(labels).tolist()) - {0, TABLE}:
            z = np.where((labels == label) & (millimetres > 0), millimetres * 0.001, np.nan)
            points = np.dstack([(columns - 319.5) * z / 525, (rows - 239.5) * z / 525, z])
            expected = learnt().respond(clouds.read(npy(points)), segments=True)
            mask = png((labels == label) * np.uint8(255))
            seen = learnt().respond(clouds.read(png(millimetres), camera=camera, mask=mask), segments=True)
            assert seen.responses.tobytes() == expected.responses.tobytes(), (file, label)
            assert seen.point_segments is not None
            assert np.array_equal(seen.point_segments, expected.point_segments)
            assert (seen.point_segments.reshape(480, 640)[labels != label] == -1).all()
            answered += 1
    assert answered > 5
