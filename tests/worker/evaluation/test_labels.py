"""Reading labels.csv, and every way in which it can be wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from service.engine.errors import InvalidParameter
from worker.evaluation.labels import judged, read_labels


@pytest.fixture
def table(tmp_path: Path) -> Path:
    for number in range(13):
        (tmp_path / f"{number}.ply").touch()
    return tmp_path / "labels.csv"


def rows(*categories: str) -> str:
    return "".join(f"{number}.ply,{category}\n" for number, category in enumerate(categories))


def test_columns_may_stand_in_any_order_and_others_are_ignored(table: Path) -> None:
    table.write_text("\ufeffsource,view,category,group,file\nOSD,v0,box,scene 1,0.ply\n", encoding="utf-8")
    (cloud,) = read_labels(table)
    assert cloud == ("0.ply", table.parent / "0.ply", "box", "scene 1", "OSD")


def test_without_groups_each_cloud_is_a_group_of_its_own(table: Path) -> None:
    table.write_text("file,category\n" + rows("box", "can"))
    assert len({cloud.group for cloud in read_labels(table)}) == 2


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "no column file and no column category"),
        ("file,kind\n0.ply,box\n", "no column category: the first line names file, kind"),
        ("file,category\n0.ply,\n", "lack a file or a category"),
        ("file,category\n0.ply\n", "lack a file or a category"),
        ("file,category\n0.ply,box\n0.ply,can\n", "named twice"),
        ("file,category\n0.ply,box\nlost.ply,box\n", "1 of the 2 clouds .* the first is 'lost.ply'"),
    ],
)
def test_what_is_wrong_with_labels_is_told(table: Path, text: str, told: str) -> None:
    table.write_text(text)
    with pytest.raises(InvalidParameter, match=told):
        read_labels(table)


def test_labels_that_are_not_there_or_no_text_are_told(table: Path) -> None:
    with pytest.raises(InvalidParameter, match="No such file"):
        read_labels(table)
    table.write_bytes(b"file,category\n\xff\xfe")
    with pytest.raises(InvalidParameter, match="cannot be read"):
        read_labels(table)
    with pytest.raises(InvalidParameter, match="cannot be read"):
        read_labels(table.parent)


def test_small_categories_and_others_are_not_judged(table: Path) -> None:
    table.write_text("file,category\n" + rows(*["box"] * 6, "other", *["can"] * 6))
    assert judged(read_labels(table)) == [0, 1, 2, 3, 4, 5, 7, 8, 9, 10, 11, 12]


@pytest.mark.parametrize("categories", [["box"] * 13, ["box"] * 7 + ["can"] * 5, ["box"] * 6 + ["other"] * 7])
def test_one_large_category_is_not_enough(table: Path, categories: list[str]) -> None:
    table.write_text("file,category\n" + rows(*categories))
    with pytest.raises(InvalidParameter, match=r"two categories of at least 6 clouds each; .* box"):
        judged(read_labels(table))
