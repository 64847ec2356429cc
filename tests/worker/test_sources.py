from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from service.clouds import write_ply
from service.engine.cloud import PointCloud
from service.engine.errors import InvalidParameter
from worker.simulation import SimulationParams, simulate
from worker.sources import Folder, Simulation


def ply(seed: int) -> bytes:
    points = np.random.default_rng(seed).normal(size=(120, 3)).astype(np.float32)
    return write_ply(PointCloud(points))


def test_a_folder_gives_its_clouds_in_the_order_of_their_paths(tmp_path: Path) -> None:
    (tmp_path / "below").mkdir()
    for name in ("b.ply", "a.PLY", "below/0.ply"):
        (tmp_path / name).write_bytes(ply(len(name)))
    (tmp_path / "labels.csv").write_text("file,category\na.PLY,box\n")
    (tmp_path / "notes.md").write_text("1 2 3")
    (tmp_path / "manifest.json").write_text("[[1, 2, 3]]")
    (tmp_path / "sheet.png").write_bytes(b"\x89PNG")
    source = Folder(tmp_path)
    assert [key for key, _ in source] == ["a.PLY", "b.ply", "below/0.ply"]
    assert source.count == 3
    assert source.refused == []


def test_what_cannot_be_read_is_refused_and_the_rest_goes_on(tmp_path: Path) -> None:
    (tmp_path / "good.ply").write_bytes(ply(1))
    (tmp_path / "broken.ply").write_bytes(ply(1)[:200])
    (tmp_path / "empty.pcd").write_bytes(b"")
    source = Folder(tmp_path)
    for _ in range(2):  # a second reading starts anew
        assert [key for key, _ in source] == ["good.ply"]
        assert sorted(key for key, _ in source.refused) == ["broken.ply", "empty.pcd"]


def test_where_the_folder_lies_is_not_part_of_the_input(tmp_path: Path) -> None:
    described = []
    for name in ("here", "there"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "a.ply").write_bytes(ply(1))
        described.append(Folder(tmp_path / name).describe())
    assert described[0] == described[1]


def test_no_folder_and_no_clouds_are_said(tmp_path: Path) -> None:
    with pytest.raises(InvalidParameter, match="no folder"):
        Folder(tmp_path / "none")
    with pytest.raises(InvalidParameter, match="no cloud"):
        Folder(tmp_path)


def test_a_simulation_gives_the_objects_of_its_seed() -> None:
    params = SimulationParams(renderer="raycast")
    source = Simulation(3, 5, params)
    expected = list(simulate(3, 5, params=params))
    given = list(source)
    assert [key for key, _ in given] == ["simulated/5/0", "simulated/5/1", "simulated/5/2"]
    for (_, cloud), simulated in zip(given, expected, strict=True):
        assert np.array_equal(cloud.points, simulated.cloud.points)
    assert source.describe()["parameters"] == params.model_dump(mode="json")
