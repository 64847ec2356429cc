"""The use cases on datasets: clouds and labels in and out, one by one, as archives, or in pieces."""

from __future__ import annotations

import posixpath
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, NamedTuple

from pydantic import BaseModel, Field, ValidationError

from service.archives import Archive, Bounds, Kind, Member, write
from service.clouds import Viewpoint
from service.clouds.formats import CLOUD_ENDINGS
from service.dataset_keys import check_key
from service.dataset_records import DatasetSummary, Entry, Flaw, Verdict, pose_of, refusal
from service.datasets import Datasets
from service.engine.errors import (
    ArchiveTooLarge,
    CloudNotFound,
    DatasetInUse,
    InvalidParameter,
    ModelDamaged,
    ModelIncompatible,
    ShapeConceptsError,
    StoreUnavailable,
    UnreadableCloud,
    UnsupportedFormat,
)
from service.labels import FILE as LABELS
from service.labels import Label, Labelled, read_labels, write_labels
from service.pool import Intake
from service.settings import Settings
from service.store import ModelStore
from service.uploads import Upload, Uploads

ABOUT = "dataset.json"  # in an archive: how its clouds are read, where they do not say so themselves
SAID = 1024  # bytes that it says of each cloud at most
TOLD = 100  # keys that an answer lists


class Reading(NamedTuple):
    """How clouds are read and taken; None where they say so themselves.

    Attributes:
        unit: of the coordinates.
        viewpoint: pose of the sensor.
        replace: whether a cloud may stand in the place of another one of its key.
        max_points: limit on the points of a cloud; None for the service's own.
        spend: is told how many files an archive holds before any of them is taken, and may raise.
    """

    unit: str | None = None
    viewpoint: Viewpoint | None = None
    replace: bool = False
    max_points: int | None = None
    spend: Callable[[int], None] = lambda files: None


class LabelsTaken(BaseModel):
    """What became of a table of labels."""

    labelled: int = Field(description="clouds that are labelled as the table says")
    unknown: int = Field(description="rows that name no cloud of the dataset, and were left out")
    first_unknown: list[str] = Field(description=f"the first of these, {TOLD} at most")


class Packed(DatasetSummary):
    """What an archive says of the dataset that it is of."""

    clouds: list[Entry] = Field(description="by key")


class DatasetCases:
    """The datasets of the service.

    Args:
        models: of the same store: a dataset that one of them learnt from is kept.
        settings: where the store is, and the limits.
    """

    def __init__(self, models: ModelStore, settings: Settings) -> None:
        self.store = Datasets(settings.store)
        self.uploads = Uploads(settings.store)
        self.room = Intake(2 * settings.max_archive)
        """Limits the bytes of archives on this machine's disk."""
        self._models = models
        self._settings = settings

    @property
    def bounds(self) -> Bounds:
        """What an archive may be."""
        settings = self._settings
        return Bounds(settings.max_entries, settings.max_unpacked, settings.max_body)

    def put(
        self, name: str, key: str, data: bytes, how: Reading, *, format: str | None = None, label: Label | None = None
    ) -> Verdict:
        """Adds a cloud, or says why it cannot be.

        Raises:
            ShapeConceptsError: it is refused.
        """
        return self.store.put(
            name,
            key,
            data,
            label=label,
            format=format,
            unit=how.unit,
            viewpoint=how.viewpoint,
            replace=how.replace,
            max_points=self._most(how),
        )

    def delete(self, name: str, *, force: bool = False) -> None:
        """Removes a dataset.

        Args:
            name: of the dataset.
            force: whether to remove it although models learnt from it.

        Raises:
            DatasetNotFound: there is none of that name.
            DatasetInUse: a model learnt from it, and it is not forced.
        """
        self.store.about(name)
        if not force and (models := self.learnt_from(name)):
            raise DatasetInUse(
                f"{len(models)} models learnt from the dataset '{name}' and could not be made again without it: "
                f"{', '.join(models[:10])}. Delete it nevertheless with force=true, or --force."
            )
        self.store.delete(name)

    def learnt_from(self, name: str) -> list[str]:
        """The models, NAME:VERSION, whose manifests name a dataset, or cannot be read by this software."""
        return [
            f"{model}:{version}"
            for model in self._models.names()
            for version in self._models.versions(model)
            if self._names(model, version, name)
        ]

    # Archives

    @contextmanager
    def spooled(self) -> Iterator[IO[bytes]]:
        """A file without a name on this machine's disk, for what is too large for the memory.

        Raises:
            StoreUnavailable: when the disk is full.
        """
        try:
            with tempfile.TemporaryFile(prefix="shape-concepts-") as file:
                yield file
        except OSError as error:
            raise StoreUnavailable(f"The temporary folder {tempfile.gettempdir()} cannot be used: {error}.") from error

    def unpack(self, name: str, file: IO[bytes], how: Reading) -> Iterator[Verdict]:
        """Adds the clouds of an archive, one after the other, and the labels that it holds.

        Sent again, what is there already is not written again.

        Args:
            name: of the dataset.
            file: the archive, seekable; open until the last verdict.
            how: its clouds are read.

        Raises:
            DatasetNotFound: there is no such dataset.
            UnreadableArchive, ArchiveTooLarge: it is refused as a whole, before anything of it was taken.
        """
        self.store.about(name)
        archive = Archive(file, self.bounds)
        how.spend(archive.check())
        told: dict[str, Entry] = {}
        yield from self._take_all(name, archive.members(lambda file: file in told or _is_wanted(file)), how, told)

    def take_folder(self, name: str, folder: Path, how: Reading) -> Iterator[Verdict]:
        """Adds the clouds of a folder and below it, by their paths in it, and the labels that it holds.

        Raises:
            DatasetNotFound: there is no such dataset.
        """
        self.store.about(name)
        files = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
        yield from self._take_all(name, (self._read(file, folder / file) for file in files), how, {})

    def take_file(self, name: str, key: str, path: Path, how: Reading) -> Verdict:
        """Adds the cloud of a file.

        Raises:
            DatasetNotFound: there is no such dataset.
        """
        return self._take(name, self._read(key, path, always=True), how, None)

    def snapshot(self, name: str) -> Packed:
        """All that a dataset holds now, but for the files of its clouds.

        Raises:
            DatasetNotFound: there is no such dataset.
        """
        return Packed(**self.store.about(name).model_dump(), clouds=self.store.entries(name))

    def pack(self, snapshot: Packed, kind: Kind) -> Iterator[bytes]:
        """The clouds of a dataset and their labels as an archive, piece by piece; `unpack` takes it.

        Raises:
            DatasetDamaged: a file is missing or was altered.
        """
        return write(self._files(snapshot), kind, snapshot.created)

    # Labels

    def take_labels(self, name: str, table: bytes, folder: str = "") -> LabelsTaken:
        """Labels clouds as a table says.

        Args:
            name: of the dataset.
            table: a `labels.csv`.
            folder: to which its files are relative.

        Raises:
            DatasetNotFound: there is no such dataset.
            InvalidParameter: it is no such table.
        """
        labels = {posixpath.join(folder, file): label for file, label in read_labels(table)}
        unknown = self.store.label(name, labels)
        return LabelsTaken(labelled=len(labels) - len(unknown), unknown=len(unknown), first_unknown=unknown[:TOLD])

    def table(self, name: str) -> bytes:
        """The labels of a dataset's clouds, as a `labels.csv`.

        Raises:
            DatasetNotFound: there is no such dataset.
        """
        return _table(self.store.entries(name))

    # Uploads in pieces

    def begin(self, name: str, length: int, *, key: str | None, how: Reading) -> Upload:
        """Begins an upload in pieces.

        Args:
            name: of the dataset.
            length: of the whole, bytes.
            key: of the cloud; None for an archive.
            how: clouds are read.

        Raises:
            DatasetNotFound: there is no such dataset.
            InvalidParameter: the key cannot be one.
        """
        self.store.about(name)
        if key is not None:
            check_key(key)
        return self.uploads.begin(name, length, key=key, replace=how.replace, unit=how.unit, viewpoint=how.viewpoint)

    def finish(self, upload: Upload, file: IO[bytes], caller: Reading) -> Iterator[Verdict]:
        """Adds what an upload brought, and forgets the upload once all is there; may be asked for again until then.

        Args:
            upload: as it stands.
            file: empty, to put it together in; open until the last verdict.
            caller: what the caller may; how clouds are read was said when the upload began.

        Raises:
            UploadConflict: some is missing.
            ShapeConceptsError: as `unpack`.
        """
        how = caller._replace(unit=upload.unit, viewpoint=pose_of(upload.viewpoint), replace=upload.replace)
        for piece in self.uploads.content(upload):
            file.write(piece)
        if upload.key is None:
            yield from self.unpack(upload.dataset, file, how)
        else:
            file.seek(0)
            yield self._take(upload.dataset, Member(upload.key, file.read()), how, None)
        self.uploads.remove(upload.id)

    # Inside

    def _take_all(
        self, name: str, members: Iterator[Member], how: Reading, told: dict[str, Entry]
    ) -> Iterator[Verdict]:
        """Adds clouds, then labels; into `told` goes what the archive of a dataset says first of its clouds."""
        tables: list[Member] = []
        for member in members:
            if member.name == ABOUT:
                told.update(self._told(member))
                yield _left_out(member.name)
            elif member.name not in told and not _is_wanted(member.name):
                yield _left_out(member.name)
            elif posixpath.basename(member.name) == LABELS:
                tables.append(member)
            else:
                yield self._take(name, member, how, told.get(member.name))
        for table in tables:
            yield self._take_table(name, table)

    def _read(self, name: str, path: Path, *, always: bool = False) -> Member:
        """A file as a member of its folder; without its bytes where nobody wants them."""
        if not always and not _is_wanted(name):
            return Member(name, b"")
        try:
            if (size := path.stat().st_size) > self.bounds.member:
                too_large = f"The file has {size} bytes; at most {self.bounds.member} are taken of one cloud."
                return Member(name, ArchiveTooLarge(too_large))
            return Member(name, path.read_bytes())
        except OSError as error:
            return Member(name, UnreadableCloud(f"The file cannot be read: {error.strerror}."))

    def _take(self, name: str, member: Member, how: Reading, told: Entry | None) -> Verdict:
        if not isinstance(member.data, bytes):
            return refusal(member.name, member.data)
        return self.store.add(
            name,
            member.name,
            member.data,
            format=told.format if told else None,
            unit=how.unit or (told.unit if told else None),
            viewpoint=how.viewpoint or (told.pose() if told else None),
            replace=how.replace,
            max_points=self._most(how),
        )

    def _take_table(self, name: str, table: Member) -> Verdict:
        try:
            if not isinstance(table.data, bytes):
                raise table.data
            taken = self.take_labels(name, table.data, posixpath.dirname(table.name))
        except (InvalidParameter, ArchiveTooLarge) as error:
            return refusal(table.name, error)
        if not taken.unknown:
            return Verdict(key=table.name, outcome="accepted")
        detail = f"{taken.unknown} of its rows name no cloud of the dataset, the first is {taken.first_unknown[0]!r}."
        return Verdict(key=table.name, outcome="accepted", error=Flaw(type=CloudNotFound.type_name(), detail=detail))

    def _told(self, member: Member) -> dict[str, Entry]:
        """What the archive of a dataset says of its clouds, by key; nothing where it is of another kind."""
        if not isinstance(member.data, bytes) or len(member.data) > SAID * self.bounds.entries:
            return {}
        try:
            return {entry.key: entry for entry in Packed.model_validate_json(member.data).clouds}
        except ValidationError:
            return {}

    def _files(self, snapshot: Packed) -> Iterator[tuple[str, bytes]]:
        yield ABOUT, snapshot.model_dump_json(indent=1).encode()
        if any(entry.label for entry in snapshot.clouds):
            yield LABELS, _table(snapshot.clouds)
        for entry in snapshot.clouds:
            yield entry.key, self.store.content(entry)

    def _most(self, how: Reading) -> int:
        return min(how.max_points or self._settings.max_points, self._settings.max_points)

    def _names(self, model: str, version: int, dataset: str) -> bool:
        try:
            return names_dataset(self._models.manifest(model, version).source, dataset)
        except ModelIncompatible:
            return True
        except ModelDamaged:  # it can be made again with no dataset
            return False


def names_dataset(source: Any, name: str) -> bool:
    """Whether the source of a model's clouds is, or has as a part, the dataset of a name."""
    if not isinstance(source, dict):
        return False
    if source.get("kind") == "dataset" and source.get("name") == name:
        return True
    parts = source.get("parts")
    return isinstance(parts, list) and any(names_dataset(part, name) for part in parts)


def _is_wanted(name: str) -> bool:
    """Whether a file of an archive is a cloud, by its name, or says something of clouds."""
    parts = name.split("/")
    if any(part.startswith(".") or part == "__MACOSX" for part in parts):
        return False
    return posixpath.splitext(name)[1].lower() in CLOUD_ENDINGS or parts[-1] == LABELS or name == ABOUT


def _left_out(name: str) -> Verdict:
    error: ShapeConceptsError = UnsupportedFormat("It is no cloud, by its name.")
    return refusal(name, error, "left-out")


def _table(entries: list[Entry]) -> bytes:
    return write_labels(Labelled(entry.key, entry.label) for entry in entries if entry.label)
