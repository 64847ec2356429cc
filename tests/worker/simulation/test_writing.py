from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from service import clouds
from worker.simulation import simulate
from worker.simulation.writing import COMPOSITIONS, CONTACT_SHEET, write


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    written = tmp_path_factory.mktemp("written") / "deeper"
    write(simulate(5, 2, renderer="raycast"), written)
    return written


def test_the_files_hold_the_clouds_to_the_bit(folder: Path) -> None:
    for simulated in simulate(5, 2, renderer="raycast"):
        read = clouds.read((folder / f"{simulated.index:04}-order{simulated.order}.ply").read_bytes())
        assert np.array_equal(read.points, simulated.cloud.points)


def test_the_truth_says_where_every_point_lies(folder: Path) -> None:
    truth = json.loads((folder / COMPOSITIONS).read_text())
    assert sorted(truth) == sorted(file.name for file in folder.glob("*.ply"))
    for simulated in simulate(5, 2, renderer="raycast"):
        told = truth[f"{simulated.index:04}-order{simulated.order}.ply"]
        assert told["order"] == len(told["prototypes"]) == simulated.order
        assert told["view"]["pose"] == simulated.view.pose.tolist()
        for prototype, true in zip(told["prototypes"], simulated.composition.prototypes, strict=True):
            assert (prototype["kind"], tuple(prototype["dimensions"])) == (true.kind, true.dimensions)
            assert prototype["pose"] == true.pose.tolist()


def test_the_contact_sheet_shows_something_in_colour(folder: Path) -> None:
    with Image.open(folder / CONTACT_SHEET) as sheet:
        pixels = np.asarray(sheet.convert("RGB")).reshape(-1, 3)
    assert len(np.unique(pixels, axis=0)) > 500


def test_nothing_unfinished_is_left(folder: Path) -> None:
    assert len(list(folder.iterdir())) == 5 + 2


def test_an_earlier_simulation_makes_way_and_foreign_files_stay(tmp_path: Path) -> None:
    write(simulate(3, 2, renderer="raycast"), tmp_path)
    (tmp_path / "mug.ply").write_bytes(b"of the user")
    (tmp_path / ".0007-order3.ply.unfinished").write_bytes(b"cut off")
    write(simulate(1, 3, renderer="raycast"), tmp_path)
    assert sorted(file.name for file in tmp_path.iterdir()) == [
        "0000-order1.ply",
        COMPOSITIONS,
        CONTACT_SHEET,
        "mug.ply",
    ]
    assert list(json.loads((tmp_path / COMPOSITIONS).read_text())) == ["0000-order1.ply"]


def test_no_object_leaves_no_picture(tmp_path: Path) -> None:
    write([], tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == [COMPOSITIONS]


def test_a_file_in_the_place_of_the_folder_is_an_error_that_names_it(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    with pytest.raises(OSError, match="taken"):
        write(simulate(1, 2, renderer="raycast"), tmp_path / "taken")
