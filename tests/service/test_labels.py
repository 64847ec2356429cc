from __future__ import annotations

import pytest

from service.engine.errors import InvalidParameter
from service.labels import COLUMNS, Label, Labelled, read_labels, write_labels


def test_what_is_written_is_read_again() -> None:
    labelled = [
        Labelled("a.ply", Label(category="mug")),
        Labelled('b "c", d.ply', Label(category="bowl", fine="x,y", instance="7", view="v", source="s\nt", group="g")),
    ]
    assert read_labels(write_labels(labelled)) == labelled
    assert write_labels([]).decode().strip() == ",".join(COLUMNS)


def test_other_columns_and_a_byte_order_mark_do_no_harm() -> None:
    table = "\ufefffile,category,colour\r\na.ply, mug ,blue\r\n".encode()
    assert read_labels(table) == [Labelled("a.ply", Label(category="mug"))]


@pytest.mark.parametrize(
    ("table", "said"),
    [
        (b"", "no column file"),
        (b"file\na\n", "no column category"),
        (b"\xff\xfe", "UTF-8"),
        (b'file,category\n"a,b\n', "comma-separated"),
        (b"file,category\na.ply,\n", "Row 2.*category"),
        (b"file,category\n,mug\n", "names no file"),
        (b"file,category\na,mug\na,bowl\n", "named twice"),
        (b"file,category\na," + b"x" * 201 + b"\n", "Row 2"),
        (b"file,category\na," + b"x" * 200_000 + b"\n", "comma-separated"),
        (b"\x00,\x00", "no column"),
    ],
)
def test_what_is_no_table_of_labels_is_refused(table: bytes, said: str) -> None:
    with pytest.raises(InvalidParameter, match=said):
        read_labels(table)
