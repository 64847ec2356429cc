"""Pieces follow one another, whoever takes them, in a folder and in a bucket."""

from __future__ import annotations

from datetime import timedelta

import pytest

from service.clouds import Viewpoint
from service.dataset_records import pose_of
from service.engine.errors import InvalidParameter, UploadConflict, UploadNotFound
from service.objects import Objects
from service.uploads import FOLDER, LEAST, Uploads

WHOLE = bytes(range(256)) * (3 * LEAST // 256) + b"end"


def test_what_comes_in_pieces_is_whole_in_the_end(url: str) -> None:
    pose = Viewpoint((0, 0, -1))
    upload = Uploads(url).begin("mugs", len(WHOLE), key="a.ply", replace=True, unit="mm", viewpoint=pose)
    offset = 0
    for size in (LEAST, 2 * LEAST, 3):
        taken = Uploads(url).append(upload.id, offset, WHOLE[offset : offset + size])
        offset += size
        assert taken == Uploads(url).show(upload.id)
        assert taken.offset == offset
    there = Uploads(url).show(upload.id)
    assert b"".join(Uploads(url).content(there)) == WHOLE
    assert (there.dataset, there.key, there.replace, there.unit) == ("mugs", "a.ply", True, "mm")
    assert pose_of(there.viewpoint) == pose
    Uploads(url).remove(upload.id)
    assert Objects(url).keys(FOLDER) == []


def test_only_the_next_piece_is_taken(url: str) -> None:
    uploads = Uploads(url)
    upload = uploads.begin("mugs", len(WHOLE))
    with pytest.raises(UploadConflict, match="go on with byte 0"):
        uploads.append(upload.id, LEAST, WHOLE[LEAST:])
    with pytest.raises(InvalidParameter, match="at least"):
        uploads.append(upload.id, 0, WHOLE[:100])
    with pytest.raises(InvalidParameter, match="beyond"):
        uploads.append(upload.id, 0, WHOLE + b"x")
    assert uploads.append(upload.id, 0, WHOLE[:LEAST]).offset == LEAST
    with pytest.raises(UploadConflict, match=f"go on with byte {LEAST}"):
        list(uploads.content(uploads.show(upload.id)))


@pytest.mark.parametrize("upload_id", ["0" * 32, "", "../../sets/mugs", "x" * 32])
def test_an_upload_that_is_not_there_is_said_so(url: str, upload_id: str) -> None:
    for ask in (Uploads(url).show, Uploads(url).remove):
        with pytest.raises(UploadNotFound):
            ask(upload_id)


def test_what_nobody_goes_on_with_is_forgotten(url: str) -> None:
    uploads = Uploads(url)
    upload = uploads.begin("mugs", len(WHOLE))
    uploads.append(upload.id, 0, WHOLE[:LEAST])
    uploads.sweep()
    assert uploads.show(upload.id).offset == LEAST
    uploads.sweep(timedelta(seconds=-60))
    assert Objects(url).keys(FOLDER) == []
