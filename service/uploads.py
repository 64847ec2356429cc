"""Uploads that may be interrupted: a large file arrives in pieces, and goes on after the last one that is there.

Layout, below the store's URL:

    datasets/uploads/<id>/upload.json          what it is to become
    datasets/uploads/<id>/pieces/<20 digits>   pieces, by their offset

A piece is written whole or not at all, with a put that creates or fails: any replica may take the next one, and of two
that claim the same offset one is refused. What nobody goes on with is swept.
"""

from __future__ import annotations

import re
import uuid
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from service.clouds import Viewpoint
from service.dataset_records import numbers_of
from service.engine.errors import InvalidParameter, UploadConflict, UploadNotFound
from service.objects import Objects

FOLDER = "datasets/uploads"
LEAST = 2**18  # bytes of a piece that is not the last one: a piece is an object of the store
FORGOTTEN = timedelta(days=2)  # after which an upload that nobody goes on with is given up
_ID = re.compile(r"[0-9a-f]{32}")


class Upload(BaseModel):
    """A file that arrives in pieces."""

    model_config = ConfigDict(frozen=True)

    id: str = Field(pattern="^[0-9a-f]{32}$", description="names the upload")
    dataset: str = Field(description="name of the dataset that it is for")
    key: str | None = Field(description="of the cloud that it becomes; null for an archive of clouds")
    length: int = Field(ge=1, description="of the whole, bytes")
    offset: int = Field(0, ge=0, description="of the next piece, bytes: so much is there")
    replace: bool = Field(False, description="whether clouds may stand in the place of others of their keys")
    unit: str | None = Field(None, description="of the coordinates; null for the files' own, or metres")
    viewpoint: tuple[float, ...] | None = Field(
        None, description="pose of the sensor, x, y, z, qw, qx, qy, qz; null for the files' own, or the origin"
    )
    created: datetime = Field(description="UTC")


class Uploads:
    """The uploads under way, in the folder or bucket of a URL."""

    def __init__(self, url: str | Path) -> None:
        self._objects = Objects(url)

    def begin(
        self,
        dataset: str,
        length: int,
        *,
        key: str | None = None,
        replace: bool = False,
        unit: str | None = None,
        viewpoint: Viewpoint | None = None,
    ) -> Upload:
        """Begins an upload; arguments are as in `Upload`."""
        self.sweep()
        upload = Upload(
            id=uuid.uuid4().hex,
            dataset=dataset,
            key=key,
            length=length,
            replace=replace,
            unit=unit,
            viewpoint=numbers_of(viewpoint),
            created=datetime.now(UTC).replace(microsecond=0),
        )
        kept = upload.model_dump_json(exclude={"offset"}).encode()
        self._objects.create(f"{FOLDER}/{upload.id}/upload.json", kept)
        return upload

    def show(self, upload_id: str) -> Upload:
        """An upload, and how much of it is there.

        Raises:
            UploadNotFound: there is none of that id.
        """
        try:
            if not _ID.fullmatch(upload_id):
                raise FileNotFoundError
            upload = Upload.model_validate_json(self._objects.get(f"{FOLDER}/{upload_id}/upload.json"))
        except (FileNotFoundError, ValidationError):
            raise UploadNotFound(
                f"There is no upload {upload_id[:40]!r}: it was finished, given up or forgotten. Begin another one."
            ) from None
        return upload.model_copy(update={"offset": sum(size for _, size in self._pieces(upload_id))})

    def append(self, upload_id: str, offset: int, data: bytes) -> Upload:
        """Takes the next piece.

        Raises:
            UploadNotFound: there is no upload of that id.
            UploadConflict: the piece begins elsewhere than where the others end.
            InvalidParameter: it is too small, or reaches beyond the whole.
        """
        upload = self.show(upload_id)
        if offset != upload.offset:
            raise UploadConflict(
                f"The piece begins at {offset}, but {upload.offset} bytes are there: go on with byte {upload.offset}."
            )
        end = offset + len(data)
        if end > upload.length:
            raise InvalidParameter(f"The piece ends at {end}, beyond the {upload.length} bytes of the whole.")
        if end < upload.length and len(data) < LEAST:
            raise InvalidParameter(f"A piece has at least {LEAST} bytes, unless it is the last; it had {len(data)}.")
        if data and not self._objects.create(f"{FOLDER}/{upload_id}/pieces/{offset:020}", data):
            raise UploadConflict("Somebody else sends pieces of this upload as well: ask how much of it is there.")
        return upload.model_copy(update={"offset": end})

    def content(self, upload: Upload) -> Iterator[bytes]:
        """The pieces of an upload of which all is there.

        Raises:
            UploadConflict: some is missing.
        """
        if upload.offset < upload.length:
            raise UploadConflict(
                f"{upload.offset} of {upload.length} bytes are there: go on with byte {upload.offset}, then finish."
            )
        for key, _ in self._pieces(upload.id):
            yield self._objects.get(key)

    def remove(self, upload_id: str) -> None:
        """Forgets an upload.

        Raises:
            UploadNotFound: there is none of that id.
        """
        self.show(upload_id)
        self._objects.remove(f"{FOLDER}/{upload_id}")

    def sweep(self, forgotten: timedelta = FORGOTTEN) -> None:
        """Removes uploads that nobody went on with for long."""
        latest: dict[str, datetime] = {}
        for found in self._objects.listing(FOLDER):
            upload_id = found.key[len(FOLDER) + 1 :].partition("/")[0]
            latest[upload_id] = max(found.modified, latest.get(upload_id, found.modified))
        for upload_id, modified in latest.items():
            if modified < datetime.now(UTC) - forgotten:
                self._objects.remove(f"{FOLDER}/{upload_id}")

    def _pieces(self, upload_id: str) -> list[tuple[str, int]]:
        """Key and size of the pieces that follow one another."""
        pieces, offset = [], 0
        for found in self._objects.listing(f"{FOLDER}/{upload_id}/pieces"):
            if int(found.key[-20:]) == offset:
                pieces.append((found.key, found.size))
                offset += found.size
        return pieces
