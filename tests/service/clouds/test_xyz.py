"""Text, as spreadsheets, scanners and people write it."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from service.clouds import read
from service.engine.errors import EmptyCloud, TooManyPoints, UnreadableCloud

EXPECTED = np.array([[0.5, -0.25, 1], [2, 1e-3, 3], [4, 5, 6]], np.float32)

TEXTS = {
    "blanks": "0.5 -0.25 1\n2 1e-3 3\n4 5 6\n",
    "no last newline": "0.5 -0.25 1\n2 1e-3 3\n4 5 6",
    "tabs and many blanks": "  0.5\t-0.25   1\n2 \t 1E-3 3  \n4 5 6\n",
    "commas": "0.5,-0.25,1\n2,1e-3,3\n4,5,6\n",
    "commas and blanks": "0.5, -0.25, 1\n2 , 1e-3 , 3\n4,5,6\n",
    "semicolons": "0.5;-0.25;1\n2;+.001;3\n4;5.;6\n",
    "windows": "0.5 -0.25 1\r\n2 1e-3 3\r\n4 5 6\r\n",
    "old mac": "0.5 -0.25 1\r2 1e-3 3\r4 5 6\r",
    "byte order mark": "\ufeff0.5 -0.25 1\n2 1e-3 3\n4 5 6\n",
    "comments": "# made\n// by hand\n0.5 -0.25 1 # first\n\n2 1e-3 3 // second\n#4 4 4\n4 5 6\n# end\n",
    "header": "X Y Z\n0.5 -0.25 1\n2 1e-3 3\n4 5 6\n",
    "header of other columns": "id,z,x,y,name\n1,1,0.5,-0.25,a\n2,3,2,1e-3,b\n3,6,4,5,c d\n",
    "header with blanks in names": "point id,x,y,z\n1,0.5,-0.25,1\n2,2,1e-3,3\n3,4,5,6\n",
    "header in quotes": '"x";"y";"z"\n0.5;-0.25;1\n2;1e-3;3\n4;5;6\n',
    "header of another separator": "# a scan\nx, y, z\n0.5 -0.25 1\n2 1e-3 3\n4 5 6\n",
    "header that names nothing known": "east north up\n\n# now\n0.5 -0.25 1\n2 1e-3 3\n4 5 6\n",
    "extra columns": "0.5 -0.25 1 255 0 red\n2 1e-3 3 255 0 blue\n4 5 6 255 0 green\n",
    "extra columns of any number": "0.5 -0.25 1 9\n2 1e-3 3\n4 5 6 9 9\n",
    "a count before the points": "3\n0.5 -0.25 1\n2 1e-3 3\n4 5 6\n",
    "missing points": "nan nan nan\n0.5 -0.25 1\nNaN NaN NaN\n2 1e-3 3\n-inf 0 1\n4 5 6\n",
}


@pytest.mark.parametrize("text", TEXTS)
def test_points_are_read_from(text: str):
    assert np.array_equal(read(TEXTS[text].encode(), "xyz").points, EXPECTED)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1 2\n3 4\n", "2 columns"),
        ("1,2,3\n4,,6\n", "could not convert string ''"),
        ("1 2 3\n4 5\n", "invalid column index"),
        ("1 2 3\n4 five 6\n", "could not convert string 'five'"),
        ("1 two 3\n4 5 6\n", "could not convert string 'two'"),
        ("0,5;0,25;1\n", "plain numbers"),
        ("x y\n1 2\n", "2 columns"),
        ("id,x,y,z\n1,2\n", "2 columns"),
        ("5\n1 2 3\n4 5 6\n", "promises 5 rows, but only 2"),
        ("1 2 3\n\x004 5 6\n", "zero bytes"),
        ("1 2 " + "3" * 100_000, "longer than"),
    ],
)
def test_what_is_no_point_is_refused_with_the_reason(text: str, said: str):
    with pytest.raises(UnreadableCloud, match=said):
        read(text.encode(), "xyz")


@pytest.mark.parametrize(
    "text", ["\n", "   \n\t\n", "# nothing\n// at all\n", "x y z\n", "x,y,z\n# none\n", "0\n", "7\n"]
)
def test_text_without_points_is_an_empty_cloud(text: str):
    with pytest.raises(EmptyCloud):
        read(text.encode(), "xyz")


def test_a_count_beyond_the_limit_is_refused_before_reading_on():
    with pytest.raises(TooManyPoints, match="1000000000000"):
        read(b"1000000000000\n0 0 0\n", "xyz")


def test_no_more_is_read_than_the_limit_takes():
    text = b"# no point\n" * 50_000 + b"0 0 0\n" * 500_000
    tracemalloc.start()
    with pytest.raises(TooManyPoints, match="limit of 1000"):
        read(text, "xyz", max_points=1000)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2 * len(text)  # all rows would be four times as much


def test_comments_are_not_counted_as_points():
    text = b"1 2 3\n  # one\n" * 1000
    assert len(read(text, "xyz", max_points=1000).points) == 1000
    with pytest.raises(TooManyPoints):
        read(text, "xyz", max_points=999)
