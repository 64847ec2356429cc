"""A folder or bucket of objects, by URL: the few operations that the stores need, with our errors."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from datetime import datetime, timedelta
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple, cast
from urllib.parse import unquote, urlsplit

import obstore
from obstore.exceptions import AlreadyExistsError, BaseError
from obstore.store import LocalStore, ObjectStore, from_url

from service.engine.errors import StoreUnavailable

STALE = 3600.0  # seconds after which what a killed writer left is swept
RETRY = {"max_retries": 3, "retry_timeout": timedelta(seconds=15)}
AT_ONCE = 16  # small objects that are asked for at the same time: a bucket takes milliseconds for each


class Found(NamedTuple):
    """An object as a listing tells it.

    Attributes:
        key: of the object.
        size: bytes.
        modified: when it was last written, by the store's clock.
    """

    key: str
    size: int
    modified: datetime


class Objects:
    """Objects below a URL: a folder (a path or `file://`), or `s3://bucket/prefix` and whatever else obstore knows.

    Credentials of buckets come from the environment (`AWS_ACCESS_KEY_ID`, `AWS_ENDPOINT_URL`, ...). A folder is made
    when something is first written; until then it is empty. Nothing is asked of a bucket before the first operation.

    Raises:
        StoreUnavailable: by every operation, when the store cannot be reached, read or written, and by the
            constructor, when the URL is of no known kind.
    """

    def __init__(self, url: str | Path) -> None:
        self.url = str(url)
        self._folder = _folder(self.url)
        self._opened: ObjectStore | None = None
        if self._folder is None:
            with self._reporting("opened"):
                opening: Any = from_url  # which of its overloads is meant, the URL tells
                self._opened = opening(self.url, retry_config=RETRY, client_options=_client_options())

    def put(self, key: str, data: bytes) -> None:
        """Writes an object at once, replacing what was there."""
        with self._reporting("written"):
            obstore.put(self._writable(), key, data)

    def create(self, key: str, data: bytes) -> bool:
        """Writes an object if there is none of that key; returns whether there was none."""
        with self._reporting("written"):
            try:
                obstore.put(self._writable(), key, data, mode="create", use_multipart=False)
            except AlreadyExistsError:
                return False
        return True

    def get(self, key: str) -> bytes:
        """The bytes of an object.

        Raises:
            FileNotFoundError: there is none of that key.
        """
        with self._reporting("read"):
            try:
                if (store := self._readable()) is not None:
                    return bytes(obstore.get(store, key).bytes())
            except FileNotFoundError:
                pass
        raise FileNotFoundError(key)

    def get_each(self, keys: Sequence[str]) -> Iterator[bytes | None]:
        """The bytes of many small objects, in their order, several asked for at a time; None where there is none."""

        def get(key: str) -> bytes | None:
            try:
                return self.get(key)
            except FileNotFoundError:
                return None

        waiting = iter(keys)
        with ThreadPoolExecutor(AT_ONCE, thread_name_prefix="objects") as threads:
            while some := list(islice(waiting, 16 * AT_ONCE)):
                yield from threads.map(get, some)

    def put_each(self, objects: Sequence[tuple[str, bytes]]) -> None:
        """Writes many small objects, several at a time, replacing what was there."""
        with ThreadPoolExecutor(AT_ONCE, thread_name_prefix="objects") as threads:
            for _ in threads.map(lambda entry: self.put(*entry), objects):
                pass

    def find(self, key: str) -> Found | None:
        """What there is of a key; None if there is nothing."""
        with self._reporting("read"):
            try:
                if (store := self._readable()) is not None:
                    return _found(obstore.head(store, key))
            except FileNotFoundError:
                pass
        return None

    def listing(self, folder: str) -> list[Found]:
        """All objects below a folder, by key."""
        with self._reporting("read"):
            if (store := self._readable()) is None:
                return []
            return sorted(_found(meta) for meta in obstore.list(store, folder, chunk_size=1000).collect())

    def remove(self, folder: str) -> None:
        """Removes all objects below a folder, if there are any."""
        self.discard(self.keys(folder))

    def discard(self, keys: Sequence[str]) -> None:
        """Removes objects; those that are not there do no harm."""
        with self._reporting("written"):
            if not keys or (store := self._readable()) is None:
                return
            try:
                obstore.delete(store, keys)
            except FileNotFoundError:  # somebody else was quicker with one of them: the others are still to go
                for key in keys:
                    with suppress(FileNotFoundError):
                        obstore.delete(store, key)

    def keys(self, folder: str, after: str | None = None) -> list[str]:
        """Keys of all objects below a folder, sorted; only those after a key, if one is given."""
        with self._reporting("read"):
            if (store := self._readable()) is None:
                return []
            return sorted(meta["path"] for meta in obstore.list(store, folder, offset=after).collect())

    def folders(self, folder: str) -> list[str]:
        """Names of the folders directly in a folder, sorted."""
        with self._reporting("read"):
            store = self._readable()
            found = [] if store is None else obstore.list_with_delimiter(store, folder)["common_prefixes"]
            return sorted(prefix.rstrip("/").rpartition("/")[2] for prefix in found)

    def numbers(self, folder: str, after: int = 0) -> list[int]:
        """Numbers of the entries of a folder that `create_number` made, ascending, from `after` + 1 on."""
        keys = self.keys(folder, f"{folder}/{after:08}.json" if after else None)
        return [int(key[-13:-5]) for key in keys if re.fullmatch(r".*/\d{8}\.json", key)]

    def create_number(self, folder: str, number: int, data: bytes) -> bool:
        """Writes a numbered entry of a folder if there is none; returns whether there was none."""
        return self.create(f"{folder}/{number:08}.json", data)

    def get_number(self, folder: str, number: int) -> bytes:
        """The bytes of a numbered entry.

        Raises:
            FileNotFoundError: there is none of that number.
        """
        return self.get(f"{folder}/{number:08}.json")

    def sweep(self) -> None:
        """Removes what writers who were killed in the middle have left in a folder; a bucket does so itself."""
        if self._folder is None or not self._folder.is_dir():
            return
        for path in self._folder.rglob("*#*"):
            with suppress(FileNotFoundError):  # its writer has just finished
                if re.search(r"#\d+$", path.name) and time.time() - path.stat().st_mtime > STALE:
                    path.unlink()

    def _readable(self) -> ObjectStore | None:
        """The store, or None for a folder that does not exist yet."""
        if self._opened is None and self._folder is not None and self._folder.exists():
            self._opened = LocalStore(prefix=self._folder, automatic_cleanup=True)
        return self._opened

    def _writable(self) -> ObjectStore:
        if self._folder is not None:
            self._folder.mkdir(parents=True, exist_ok=True)
        return cast(ObjectStore, self._readable())

    @contextmanager
    def _reporting(self, done: str) -> Iterator[None]:
        """Says which store failed, and of the library's message its first line: the rest is a dump of its innards."""
        try:
            yield
        except (BaseError, OSError, ValueError) as error:
            reason = (str(error).strip() or type(error).__name__).splitlines()[0].partition(": <?xml")[0]
            raise StoreUnavailable(f"The store {self.url} cannot be {done}: {reason}") from error


def _found(meta: Any) -> Found:
    return Found(meta["path"], meta["size"], meta["last_modified"])


def _folder(url: str) -> Path | None:
    """The folder that a path or `file://` URL means; None for any other URL."""
    parts = urlsplit(url)
    if parts.scheme == "file":
        return Path(unquote(parts.path))
    return None if len(parts.scheme) > 1 else Path(url).expanduser().absolute()


def _client_options() -> dict[str, Any]:
    """Plain HTTP is allowed when the environment names an endpoint with it: a server beside us."""
    endpoint = os.environ.get("AWS_ENDPOINT_URL") or os.environ.get("AWS_ENDPOINT") or ""
    return {"connect_timeout": "5s", "timeout": "120s", "allow_http": endpoint.startswith("http://")}
