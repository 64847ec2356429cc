"""Datasets: uploaded clouds by name and key, each content stored once, in the folder or bucket of the models.

Layout, below the store's URL:

    datasets/blobs/sha256/<hex>                files of clouds, by content
    datasets/sets/<name>/dataset.json          a dataset exists when this does
    datasets/sets/<name>/clouds/<key>=.json    which content a key means (`service/dataset_keys.py`: how it is written)
    datasets/sets/<name>/labels/<key>=.json    what the cloud shows, apart from it

A cloud is there once its entry is: the content is written first, and the entry with a put that creates or fails. So
uploads at the same time never lose one another, and of one that is killed nothing is seen.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

from pydantic import ValidationError

from service import clouds
from service.clouds.formats import tell
from service.dataset_keys import check_key, key_of, path_of
from service.dataset_records import Dataset, DatasetSummary, Entry, Outcome, Verdict, digest_of, numbers_of, refusal
from service.engine.cloud import normalise
from service.engine.errors import (
    CloudExists,
    CloudNotFound,
    DatasetDamaged,
    DatasetExists,
    DatasetNotFound,
    ShapeConceptsError,
    StoreUnavailable,
    UnsupportedFormat,
)
from service.engine.params import CloudParams
from service.labels import Label
from service.model_file import check_name
from service.objects import Objects

SETS = "datasets/sets"
BLOBS = "datasets/blobs/sha256"
UNDER_WAY = timedelta(minutes=15)  # a content that nobody names may be that of an upload that has just begun


class Datasets:
    """The datasets in the folder or bucket of a URL."""

    def __init__(self, url: str | Path) -> None:
        self._objects = Objects(url)
        self.url = self._objects.url

    # Datasets

    def create(self, name: str, description: str = "") -> DatasetSummary:
        """Makes a dataset; made again with the same description, or none, it is the same dataset.

        Raises:
            InvalidParameter: the name is not of that form.
            DatasetExists: there is one of that name with another description.
        """
        check_name(name, " dataset")
        made = DatasetSummary(name=name, description=description, created=datetime.now(UTC).replace(microsecond=0))
        if self._objects.create(_about(name), made.model_dump_json().encode()):
            return made
        there = self.about(name)
        if description not in ("", there.description):
            raise DatasetExists(f"There is a dataset '{name}' already, of the description '{there.description[:100]}'.")
        return there

    def names(self) -> list[str]:
        """Names of all datasets, sorted."""
        return [name for name in self._objects.folders(SETS) if self._objects.find(_about(name))]

    def about(self, name: str) -> DatasetSummary:
        """A dataset, without what it holds.

        Raises:
            DatasetNotFound: there is none of that name.
        """
        check_name(name, " dataset")
        try:
            return DatasetSummary.model_validate_json(self._objects.get(_about(name)))
        except FileNotFoundError:
            raise self._no_dataset(name) from None
        except ValidationError as error:
            raise DatasetDamaged(f"The description of the dataset '{name}' was cut off or altered.") from error

    def show(self, name: str) -> Dataset:
        """A dataset, and what it holds.

        Raises:
            DatasetNotFound: there is none of that name.
        """
        about, entries = self.about(name), self.entries(name)
        return Dataset(
            **about.model_dump(),
            clouds=len(entries),
            bytes=sum(entry.bytes for entry in entries),
            formats=dict(sorted(Counter(entry.format for entry in entries).items())),
            categories=dict(sorted(Counter(entry.label.category for entry in entries if entry.label).items())),
            digest=digest_of(entries),
        )

    def delete(self, name: str) -> None:
        """Removes a dataset, and the contents that no other one has.

        A content that was written a moment ago stays until something is deleted later: an upload to another dataset
        may be about to name it.

        Raises:
            DatasetNotFound: there is none of that name.
        """
        self.about(name)
        self._objects.remove(f"{SETS}/{name}/clouds")  # killed on the way, there is still a dataset to delete
        self._objects.discard([_about(name)])
        self._objects.remove(f"{SETS}/{name}")
        self.sweep()

    def sweep(self, spared: timedelta = UNDER_WAY) -> None:
        """Removes contents that no dataset names, but for those written within a time."""
        self._objects.sweep()
        before = datetime.now(UTC) - spared
        old = [blob.key for blob in self._objects.listing(BLOBS) if blob.modified < before]
        named = {_blob(entry.sha256) for name in self.names() for entry in self._entries(name)} if old else set()
        for key in old:
            if key not in named and (blob := self._objects.find(key)) and blob.modified < before:
                self._objects.discard([key])

    # Clouds

    def add(
        self,
        name: str,
        key: str,
        data: bytes,
        *,
        label: Label | None = None,
        format: str | None = None,
        unit: str | None = None,
        viewpoint: clouds.Viewpoint | None = None,
        replace: bool = False,
        max_points: int = clouds.MAX_POINTS,
    ) -> Verdict:
        """Adds a cloud as `put`, and tells what is wrong with it instead of raising.

        Raises:
            DatasetNotFound: there is no such dataset.
            StoreUnavailable: the store cannot be written.
        """
        try:
            return self.put(
                name,
                key,
                data,
                label=label,
                format=format,
                unit=unit,
                viewpoint=viewpoint,
                replace=replace,
                max_points=max_points,
            )
        except (DatasetNotFound, DatasetDamaged, StoreUnavailable):
            raise
        except ShapeConceptsError as error:
            return refusal(key, error)

    def put(
        self,
        name: str,
        key: str,
        data: bytes,
        *,
        label: Label | None = None,
        format: str | None = None,
        unit: str | None = None,
        viewpoint: clouds.Viewpoint | None = None,
        replace: bool = False,
        max_points: int = clouds.MAX_POINTS,
    ) -> Verdict:
        """Adds a cloud, if it is one that can be learnt from.

        Args:
            name: of the dataset.
            key: of the cloud, a relative path.
            data: the file's bytes; they are stored as they are.
            label: what it shows.
            format: of the file; None to tell it from the content, then from the key's ending.
            unit: of the coordinates, as `clouds.read`.
            viewpoint: pose of the sensor, as `clouds.read`.
            replace: whether it may stand in the place of another cloud of that key.
            max_points: limit on the points.

        Raises:
            DatasetNotFound: there is no such dataset.
            CloudExists: there is another cloud of that key, and it is not to be replaced.
            ShapeConceptsError: the key cannot be one, or the cloud cannot be read or learnt from.
        """
        self.about(name)
        path = _cloud(name, check_key(key))
        there = self._entry(path)
        sent = (hashlib.sha256(data).hexdigest(), unit, numbers_of(viewpoint))
        same = (
            there is not None and (there.sha256, there.unit, there.viewpoint) == sent and format in (None, there.format)
        )
        if same and self._objects.find(_blob(sent[0])):
            outcome: Outcome = "already-there"  # and was looked at when it came
        elif there is not None and not same and not replace:
            raise _other(name, key)
        else:
            entry = _validated(key, data, format, unit, viewpoint, max_points)
            outcome = self._write(name, path, entry, data, replace=there is not None)
        if label is not None:
            self.label(name, {key: label})
        return Verdict(key=key, outcome=outcome, sha256=sent[0])

    def entries(self, name: str) -> list[Entry]:
        """All clouds of a dataset with their labels, by key.

        Raises:
            DatasetNotFound: there is no such dataset.
        """
        self.about(name)
        labels = self.labels(name)
        return [_with(entry, labels) for entry in self._entries(name)]

    def page(self, name: str, after: str = "", limit: int = 100) -> list[Entry]:
        """Some clouds of a dataset with their labels, by key: those after a key, `limit` of them at most.

        Raises:
            DatasetNotFound: there is no such dataset.
        """
        self.about(name)
        keys = [key for key in self.keys(name) if key > after][:limit]
        labels = self._labels(name, keys)
        return [_with(entry, labels) for entry in self._read_entries(name, keys)]

    def keys(self, name: str) -> list[str]:
        """Keys of all clouds of a dataset, sorted; none when there is no such dataset."""
        return self._keys(f"{SETS}/{name}/clouds")

    def entry(self, name: str, key: str) -> Entry:
        """A cloud with its label.

        Raises:
            DatasetNotFound, CloudNotFound: there is no such dataset, or it has no such cloud.
        """
        self.about(name)
        entry = self._entry(_cloud(name, check_key(key)))
        if entry is None:
            raise CloudNotFound(f"The dataset '{name}' has no cloud {key!r}; list its clouds to see which it has.")
        return _with(entry, self._labels(name, [key]))

    def read(self, name: str, key: str) -> bytes:
        """The file of a cloud, byte for byte as it was sent.

        Raises:
            DatasetNotFound, CloudNotFound: there is no such dataset, or it has no such cloud.
            DatasetDamaged: it was altered.
        """
        return self.content(self.entry(name, key))

    def content(self, entry: Entry) -> bytes:
        """The file that an entry names.

        Raises:
            DatasetDamaged: it was altered, or is missing.
        """
        try:
            data = self._objects.get(_blob(entry.sha256))
        except FileNotFoundError:
            raise DatasetDamaged(f"The file of the cloud {entry.key!r} is missing in the store.") from None
        if hashlib.sha256(data).hexdigest() != entry.sha256:
            raise DatasetDamaged(f"The file of the cloud {entry.key!r} was altered in the store.")
        return data

    def digest(self, name: str) -> str:
        """SHA-256 of the keys and contents of a dataset's clouds: equal for equal clouds, however they are labelled.

        Raises:
            DatasetNotFound: there is no such dataset.
        """
        self.about(name)
        return digest_of(self._entries(name))

    # Labels

    def label(self, name: str, labels: dict[str, Label]) -> list[str]:
        """Says what clouds show, in the place of what was said before; returns the keys of which there is no cloud.

        Raises:
            DatasetNotFound: there is no such dataset.
        """
        self.about(name)
        there = set(self.keys(name)) if len(labels) > 1 else {key for key in labels if self._is_there(name, key)}
        taken = [(key, label) for key, label in labels.items() if key in there]
        self._objects.put_each([(_label(name, key), label.model_dump_json().encode()) for key, label in taken])
        return [key for key in labels if key not in there]

    def labels(self, name: str) -> dict[str, Label]:
        """What is said of clouds, by key, sorted."""
        return self._labels(name, self._keys(f"{SETS}/{name}/labels"))

    # Inside

    def _write(self, name: str, path: str, entry: Entry, data: bytes, *, replace: bool) -> Outcome:
        """Writes the content, then the entry; somebody else may write, or delete, at the same time."""
        self._objects.put(_blob(entry.sha256), data)
        line = entry.model_dump_json(exclude={"label"}).encode()
        if replace:
            self._objects.put(path, line)
        elif not self._objects.create(path, line):
            there = self._entry(path)
            if there is None or not there.is_same(entry):
                raise _other(name, entry.key)
            return "already-there"
        if self._objects.find(_about(name)) is None:  # deleted meanwhile: not to be found in the next one of that name
            self._objects.discard([path])
            raise self._no_dataset(name)
        return "replaced" if replace else "accepted"

    def _keys(self, folder: str) -> list[str]:
        paths = (path[len(folder) + 1 :] for path in self._objects.keys(folder))
        return sorted(key for path in paths if (key := key_of(path)) is not None)

    def _is_there(self, name: str, key: str) -> bool:
        return self._objects.find(_cloud(name, check_key(key))) is not None

    def _entries(self, name: str) -> list[Entry]:
        return self._read_entries(name, self.keys(name))

    def _read_entries(self, name: str, keys: Sequence[str]) -> list[Entry]:
        paths = [_cloud(name, key) for key in keys]
        found = zip(paths, self._objects.get_each(paths), strict=True)
        return [_parsed(path, data) for path, data in found if data is not None]

    def _entry(self, path: str) -> Entry | None:
        try:
            return _parsed(path, self._objects.get(path))
        except FileNotFoundError:
            return None

    def _labels(self, name: str, keys: Sequence[str]) -> dict[str, Label]:
        found = zip(keys, self._objects.get_each([_label(name, key) for key in keys]), strict=True)
        try:
            return {key: Label.model_validate_json(data) for key, data in found if data is not None}
        except ValidationError as error:
            raise DatasetDamaged(f"A label of the dataset '{name}' was cut off or altered.") from error

    def _no_dataset(self, name: str) -> DatasetNotFound:
        there = self.names()
        known = f"The store holds: {', '.join(there[:20])}." if there else "The store holds none yet: create it first."
        return DatasetNotFound(f"There is no dataset '{name}'. {known}")


def _validated(
    key: str, data: bytes, format: str | None, unit: str | None, viewpoint: clouds.Viewpoint | None, max_points: int
) -> Entry:
    """The entry of a cloud that can be learnt from.

    Raises:
        ShapeConceptsError: it is none; the message says why.
    """
    name = key.rpartition("/")[2]
    format = format or (tell(data, name) if data else None)
    if format == "png":
        raise UnsupportedFormat(
            "A depth image has no place in a dataset: cut the object out and send its points, as PLY, PCD or NPY."
        )
    cloud = clouds.read(data, format, name=name, unit=unit, viewpoint=viewpoint, max_points=max_points)
    normalise(cloud, CloudParams())
    return Entry(
        key=key,
        sha256=hashlib.sha256(data).hexdigest(),
        bytes=len(data),
        format=format or "",
        points=len(cloud.points),
        unit=unit,
        viewpoint=numbers_of(viewpoint),
        added=datetime.now(UTC).replace(microsecond=0),
    )


def _parsed(path: str, data: bytes) -> Entry:
    try:
        entry = Entry.model_validate_json(data)
    except ValidationError as error:
        raise DatasetDamaged(f"The entry {path} was cut off or altered.") from error
    if not path.endswith(f"/{path_of(entry.key)}"):
        raise DatasetDamaged(f"The entry {path} is that of {entry.key!r}: moved, or altered.")
    return entry


def _with(entry: Entry, labels: dict[str, Label]) -> Entry:
    return entry.model_copy(update={"label": labels.get(entry.key)})


def _other(name: str, key: str) -> CloudExists:
    return CloudExists(
        f"The dataset '{name}' has another cloud {key!r}: give this one another key, or say that it shall replace it."
    )


def _about(name: str) -> str:
    return f"{SETS}/{name}/dataset.json"


def _cloud(name: str, key: str) -> str:
    return f"{SETS}/{name}/clouds/{path_of(key)}"


def _label(name: str, key: str) -> str:
    return f"{SETS}/{name}/labels/{path_of(key)}"


def _blob(sha256: str) -> str:
    return f"{BLOBS}/{sha256}"
