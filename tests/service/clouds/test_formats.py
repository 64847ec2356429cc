"""Telling formats by content, name and media type."""

from __future__ import annotations

import pytest

from service.clouds.formats import FORMATS, by_content, by_media_type, tell
from service.engine.errors import UnsupportedFormat
from tests.conftest import ROOT
from tests.service.clouds.written import every_kind, some_points

KINDS = every_kind(some_points())


@pytest.mark.parametrize("kind", KINDS)
def test_content_tells_the_format_whatever_the_name(kind: str):
    assert tell(KINDS[kind]) == kind.split()[0]
    if not kind.startswith("xyz"):
        assert by_content(KINDS[kind]) == kind.split()[0]
        assert tell(KINDS[kind], "cloud.csv") == kind.split()[0]


@pytest.mark.parametrize("head", [b"VERSION 0.7\n", b"# a scan\n\n# of mine\nFIELDS x y z\n", b"# .PCD v0.7"])
def test_pcd_headers_begin_in_several_ways(head: bytes):
    assert by_content(head) == "pcd"


@pytest.mark.parametrize("entry", FORMATS.values(), ids=FORMATS)
def test_names_tell_where_content_does_not(entry):
    for ending in entry.endings:
        assert tell(b"\xff\x00", f"a.b/c{ending.upper()}") == entry.name


@pytest.mark.parametrize("text", [b"1 2 3", b"# c\n0.1,0.2,0.3\n", b"x;y;z\n-.1;+2.;3e-5\n", b"5\n1 2 3 red\n"])
def test_lines_that_read_like_points_are_xyz(text: bytes):
    assert tell(text) == "xyz"


@pytest.mark.parametrize(
    "data", [b"solid cube\nfacet normal 0 0 0\n", b"\x89PNG\r\n", b"hello world\n", b"{}", b"[1, 2, 3]", b"\x00"]
)
def test_anything_else_is_refused_with_the_formats_that_exist(data: bytes):
    with pytest.raises(UnsupportedFormat) as refused:
        tell(data, "thing.stl")
    assert all(entry.title in str(refused.value) for entry in FORMATS.values())
    assert "thing.stl" in str(refused.value)


def test_media_types_name_formats():
    for entry in FORMATS.values():
        for media_type in entry.media_types:
            assert by_media_type(media_type) in (entry.name, None)
    assert by_media_type("Text/CSV; charset=utf-8") == "xyz"


def test_cdr_may_say_which_message_it_is_and_no_other_than_a_cloud():
    for said in ("", "; type=sensor_msgs/msg/PointCloud2", ";sensor_msgs::msg::dds_::PointCloud2_"):
        assert by_media_type("application/cdr" + said) == "pointcloud2"
    with pytest.raises(UnsupportedFormat, match="PointCloud2 is read"):
        by_media_type("application/x-ros-cdr; type=sensor_msgs/msg/Image")


@pytest.mark.parametrize("media_type", ["", "application/octet-stream", "text/plain; charset=utf-8"])
def test_unspecific_media_types_leave_it_to_the_content(media_type: str):
    assert by_media_type(media_type) is None


def test_foreign_media_types_are_refused_with_those_that_exist():
    with pytest.raises(UnsupportedFormat, match="model/ply"):
        by_media_type("image/jpeg")


def test_no_two_formats_share_an_ending_or_a_media_type():
    for attribute in ("endings", "media_types"):
        every = [value for entry in FORMATS.values() for value in getattr(entry, attribute)]
        assert len(every) == len(set(every))


def test_the_documents_name_every_format_that_is_read():
    page = (ROOT / "docs" / "interfaces.md").read_text()
    for entry in FORMATS.values():
        assert f"`{entry.media_types[0]}`" in page, entry.name
