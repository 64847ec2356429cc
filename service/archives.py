"""Archives of clouds, zip or tar: read member by member within bounds, and written as a stream.

Nothing is ever extracted to disk by name, and nothing an archive says of itself is believed: it is looked through
before a member of it is used, and refused as a whole when it reaches out of itself, holds links or devices, or unfolds
out of proportion.
"""

from __future__ import annotations

import gzip
import io
import stat
import tarfile
import zipfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from datetime import datetime
from typing import IO, Any, Literal, NamedTuple, cast

from service.clouds.claims import quote
from service.engine.errors import ArchiveTooLarge, ShapeConceptsError, UnreadableArchive

Kind = Literal["zip", "tar.gz"]
ENDINGS = (".zip", ".tar.gz", ".tgz", ".tar")
MEDIA_TYPES: dict[Kind, str] = {"zip": "application/zip", "tar.gz": "application/gzip"}
RATIO = 250  # a cloud of which hardly a point was measured unfolds a hundredfold; zeros a thousandfold
TOLERATED = 2**24  # bytes that any archive may unfold to
HEADERS = 2**18  # bytes of headers before a member of a tar: names may be long, but not endless
LISTED = 512  # bytes of an entry in a zip's list: its name, and what else is said of it
PIECE = 2**18  # bytes read at a time
_DIRECTORY_ENTRY = b"PK\x01\x02"


class Bounds(NamedTuple):
    """What an archive may be.

    Attributes:
        entries: number of its members.
        unpacked: bytes of all members together.
        member: bytes of one member; a larger one is told, and not read.
    """

    entries: int = 100_000
    unpacked: int = 8 * 2**30
    member: int = 128 * 2**20


class Member(NamedTuple):
    """A file in an archive.

    Attributes:
        name: its path in the archive, relative.
        data: its bytes; an error where they cannot be had.
    """

    name: str
    data: bytes | ShapeConceptsError


class Archive:
    """An archive in a file.

    Args:
        file: seekable, open for reading; it stays open.
        bounds: on what it may be.

    Raises:
        UnreadableArchive: by every method: it is neither zip nor tar, damaged, or reaches out of itself.
        ArchiveTooLarge: by every method: it goes beyond the bounds.
    """

    def __init__(self, file: IO[bytes], bounds: Bounds) -> None:
        self._file = file
        self._bounds = bounds
        file.seek(0)
        head = file.read(512)
        self._is_zip = head[:4] in (b"PK\x03\x04", b"PK\x05\x06")
        self._is_packed = head[:2] == b"\x1f\x8b"
        if not self._is_zip and not self._is_packed and head[257:262] != b"ustar":
            raise UnreadableArchive(
                f"It is neither a zip nor a tar archive, packed with gzip or not: it begins with {quote(head[:8])}."
            )

    def check(self) -> int:
        """Looks through all of it; returns how many files it holds."""
        return sum(1 for _ in self._walk(lambda name: False))

    def members(self, wanted: Callable[[str], bool]) -> Iterator[Member]:
        """Its files in their order; those that are not wanted have no bytes."""
        return self._walk(wanted)

    def _walk(self, wanted: Callable[[str], bool]) -> Iterator[Member]:
        with _telling():
            yield from self._of_zip(wanted) if self._is_zip else self._of_tar(wanted)

    def _of_zip(self, wanted: Callable[[str], bool]) -> Iterator[Member]:
        with zipfile.ZipFile(cast(IO[bytes], _Careful(self._file, self._bounds.entries))) as archive:
            infos = archive.infolist()
            self._check_count(len(infos))
            for info in infos:
                _check_name(info.filename)
                if stat.S_IFMT(info.external_attr >> 16) not in (0, stat.S_IFREG, stat.S_IFDIR):
                    raise _no_file(info.filename)
            packed = sum(info.compress_size for info in infos)
            unpacked = sum(info.file_size for info in infos)
            self._check_unpacked(unpacked)
            _check_ratio(unpacked, min(packed, self._size()))
            for info in infos:
                if not info.is_dir():
                    name = _plain(info.filename)
                    yield Member(name, self._unzip(archive, info) if wanted(name) else b"")

    def _unzip(self, archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> bytes | ShapeConceptsError:
        if info.file_size > self._bounds.member:
            return self._too_large(info.file_size)
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) or info.flag_bits & 1:
            return UnreadableArchive("The file is encrypted, or packed by another method than deflate: zip it again.")
        try:
            with archive.open(info) as file:
                return b"".join(iter(lambda: file.read(PIECE), b""))
        except Exception as error:  # zipfile lets errors of zlib, struct and its own through
            return UnreadableArchive(f"The file is damaged in the archive: {quote(str(error), 120)}.")

    def _of_tar(self, wanted: Callable[[str], bool]) -> Iterator[Member]:
        self._file.seek(0)
        metered = _Metered(self._file, self._is_packed, self._bounds.unpacked + 2048 * self._bounds.entries)
        count = unpacked = 0
        with tarfile.open(fileobj=cast(IO[bytes], metered), mode="r|", tarinfo=_Strict) as archive:
            while (info := metered.header(archive.next)) is not None:
                archive.members.clear()  # type: ignore[attr-defined] # else it keeps all of them
                count += 1
                self._check_count(count)
                unpacked += max(0, info.size)
                self._check_unpacked(unpacked)
                _check_name(info.name)
                if not info.isdir():
                    yield self._untar(archive, info, wanted)

    def _untar(self, archive: tarfile.TarFile, info: tarfile.TarInfo, wanted: Callable[[str], bool]) -> Member:
        """The member at which the archive stands; all of it is read, wanted or not."""
        if not info.isreg() or info.issparse() or info.size < 0:
            raise _no_file(info.name)
        name, file = _plain(info.name), cast(IO[bytes], archive.extractfile(info))
        too_large = info.size > self._bounds.member
        if wanted(name) and not too_large:
            return Member(name, file.read())
        while file.read(PIECE):
            pass
        return Member(name, self._too_large(info.size) if too_large else b"")

    def _size(self) -> int:
        return self._file.seek(0, io.SEEK_END)

    def _check_count(self, count: int) -> None:
        if count > self._bounds.entries:
            raise ArchiveTooLarge(f"The archive has more than {self._bounds.entries} entries: send it in parts.")

    def _check_unpacked(self, unpacked: int) -> None:
        if unpacked > self._bounds.unpacked:
            raise ArchiveTooLarge(f"The archive unfolds to more than {self._bounds.unpacked} bytes: send it in parts.")

    def _too_large(self, size: int) -> ArchiveTooLarge:
        return ArchiveTooLarge(f"The file has {size} bytes; at most {self._bounds.member} are taken of one cloud.")


class _Careful:
    """The file of a zip, of which a list of too many entries is not even handed on."""

    def __init__(self, file: IO[bytes], entries: int) -> None:
        self._file = file
        self._entries = entries
        self.seek, self.tell = file.seek, file.tell

    def seekable(self) -> bool:
        return True

    def read(self, size: int = -1) -> bytes:
        most = LISTED * self._entries + PIECE
        data = self._file.read(most + 1 if size < 0 else min(size, most + 1))
        if len(data) > most or data.count(_DIRECTORY_ENTRY) > self._entries:
            raise ArchiveTooLarge(f"The archive has more than {self._entries} entries: send it in parts.")
        return data


class _Strict(tarfile.TarInfo):
    """A header of a tar; one that is none, or cut off, is no end."""

    @classmethod
    def fromtarfile(cls, archive: Any) -> Any:
        try:
            return super().fromtarfile(archive)
        except tarfile.EOFHeaderError:  # type: ignore[attr-defined] # blocks of zeros: the end
            raise
        except tarfile.HeaderError as error:
            raise UnreadableArchive(f"The archive is truncated or damaged ({error}): send it again.") from error


class _Metered:
    """What a tar reads: unpacked as it is read, and counted."""

    def __init__(self, file: IO[bytes], packed: bool, most: int) -> None:
        self._file = file
        self._unpacked = cast(IO[bytes], gzip.GzipFile(fileobj=file) if packed else file)
        self._most = most
        self._count = 0
        self._headers: int | None = 0  # bytes of the headers that are being read

    def read(self, size: int) -> bytes:
        data = self._unpacked.read(size)
        self._count += len(data)
        if self._count > self._most:
            raise ArchiveTooLarge(f"The archive unfolds to more than {self._most} bytes: send it in parts.")
        if self._headers is not None:
            self._headers += len(data)
            if self._headers > HEADERS:
                raise ArchiveTooLarge("The archive has a header that is longer than any name: it was not read.")
        if self._unpacked is not self._file:
            _check_ratio(self._count, self._file.tell())
        return data

    def header(self, following: Callable[[], tarfile.TarInfo | None]) -> tarfile.TarInfo | None:
        """The next header; of what stands before it, all was read."""
        self._headers = 0
        try:
            return following()
        finally:
            self._headers = None


def write(files: Iterable[tuple[str, bytes]], kind: Kind, written: datetime) -> Iterator[bytes]:
    """An archive of files, piece by piece; with the same files and time, the same bytes.

    Args:
        files: name and bytes of each; one is in memory at a time.
        kind: of the archive.
        written: time that it gives for all of them, UTC.
    """
    sink = _Sink()
    if kind == "zip":
        with zipfile.ZipFile(cast(IO[bytes], sink), "w", zipfile.ZIP_DEFLATED) as archive:
            for name, data in files:
                info = zipfile.ZipInfo(name, max(written, datetime(1980, 1, 1, tzinfo=written.tzinfo)).timetuple()[:6])
                info.compress_type, info.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
                archive.writestr(info, data)
                yield sink.taken()
    else:
        with (
            gzip.GzipFile("", "wb", 6, cast(IO[bytes], sink), int(written.timestamp())) as packed,
            tarfile.open(fileobj=packed, mode="w|", format=tarfile.PAX_FORMAT) as tar,
        ):
            for name, data in files:
                entry = tarfile.TarInfo(name)
                entry.size, entry.mtime = len(data), int(written.timestamp())
                tar.addfile(entry, io.BytesIO(data))
                yield sink.taken()
    yield sink.taken()


class _Sink:
    """Keeps what is written until it is taken."""

    def __init__(self) -> None:
        self._pieces: list[bytes] = []

    def write(self, data: Any) -> int:
        self._pieces.append(bytes(data))
        return len(data)

    def flush(self) -> None:
        pass

    def taken(self) -> bytes:
        pieces, self._pieces = self._pieces, []
        return b"".join(pieces)


@contextmanager
def _telling() -> Iterator[None]:
    """Tells what libraries raise about an archive; they let errors of zlib, struct, codecs and recursion through."""
    try:
        yield
    except (ShapeConceptsError, GeneratorExit):
        raise
    except Exception as error:
        raise UnreadableArchive(f"The archive is truncated or damaged ({quote(str(error), 120)}).") from error


def _check_ratio(unpacked: int, packed: int) -> None:
    if unpacked > max(TOLERATED, RATIO * packed):
        raise ArchiveTooLarge(f"The archive unfolds to more than {RATIO} times its length; it was not unpacked.")


def _check_name(name: str) -> None:
    """Refuses a name that would lead out of the archive.

    Raises:
        UnreadableArchive: it does.
    """
    parts = name.replace("\\", "/").split("/")
    if ".." in parts or parts[0] == "" or parts[0][1:2] == ":":
        raise UnreadableArchive(f"The archive has an entry {quote(name)}, which leads out of it: nothing was taken.")


def _plain(name: str) -> str:
    """A name without the `./` that tar begins names with."""
    while name.startswith("./"):
        name = name[2:]
    return name


def _no_file(name: str) -> UnreadableArchive:
    return UnreadableArchive(
        f"The archive's entry {quote(name)} is a link, a device or sparse: only files and folders are taken, and "
        "nothing was."
    )
