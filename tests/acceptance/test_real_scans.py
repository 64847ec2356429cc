"""Real depth-camera scans, as files, through a model that has only seen simulated objects."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from service import clouds
from service.engine.cloud import PointCloud
from tests.learnt import learnt

EVERY = 12  # of each set

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
