"""Vectors of other programs: whose they are, and every way in which they can be wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from service.engine.errors import InvalidParameter
from worker.evaluation.vector_files import read_vector_file


def written(folder: Path, text: str) -> Path:
    file = folder / "vfh.csv"
    file.write_text(text)
    return file


def test_clouds_are_known_by_their_names_whatever_their_folder_and_ending(tmp_path: Path) -> None:
    vectors = read_vector_file("VFH", written(tmp_path, "/elsewhere/a.pcd,1,2\n./b.1.pcd,3,4e-1\n"))
    assert vectors.has(["objects/b.1.ply", "a.ply"])
    assert vectors.of(["objects/b.1.ply", "a.ply"]).tolist() == [[3, 0.4], [1, 2]]
    assert not vectors.has(["c.ply"])


def test_a_cloud_without_vector_is_named(tmp_path: Path) -> None:
    vectors = read_vector_file("VFH", written(tmp_path, "a.pcd,1,2\n"))
    with pytest.raises(InvalidParameter, match="lack 1 of the 2 clouds, the first is 'lost'"):
        vectors.of(["a.ply", "lost.ply"])


def test_two_clouds_of_one_name_cannot_be_told_apart(tmp_path: Path) -> None:
    vectors = read_vector_file("VFH", written(tmp_path, "a.pcd,1,2\n"))
    with pytest.raises(InvalidParameter, match="Several clouds are called 'a'"):
        vectors.of(["left/a.ply", "right/a.ply"])


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "lengths of nothing"),
        ("a.pcd\n", "at least two numbers"),
        ("a.pcd,1\n", "at least two numbers"),
        ("a.pcd,1,2\nb.pcd,1,2,3\n", "lengths of 2, 3"),
        ("a.pcd,1,two\n", "no number"),
        ("a.pcd,1,nan\n", "infinite"),
        ("a.pcd,1,2\nx/a.ply,3,4\n", "name the cloud 'a' twice"),
    ],
)
def test_what_is_wrong_with_vectors_is_told(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(InvalidParameter, match=told):
        read_vector_file("VFH", written(tmp_path, text))


def test_vectors_that_are_not_there_or_no_text_are_told(tmp_path: Path) -> None:
    with pytest.raises(InvalidParameter, match="No such file"):
        read_vector_file("VFH", tmp_path / "lost.csv")
    (tmp_path / "binary.csv").write_bytes(np.arange(200, 256, dtype=np.uint8).tobytes())
    with pytest.raises(InvalidParameter, match="cannot be read"):
        read_vector_file("VFH", tmp_path / "binary.csv")
