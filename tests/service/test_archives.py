"""What an archive holds is read, and what it might do is refused before anything of it is used."""

from __future__ import annotations

import gzip
import io
import random
import struct
import tarfile
import tracemalloc
import zipfile
from collections.abc import Callable
from datetime import UTC, datetime

import pytest

from service.archives import Archive, Bounds, Kind, write
from service.engine.errors import ArchiveTooLarge, ShapeConceptsError, UnreadableArchive

FILES = [("a.ply", b"first"), ("deep/er/b.pcd", bytes(range(256)) * 30), ("empty", b""), ("ä b.ply", b"x")]
NOW = datetime(2026, 11, 22, 10, 0, tzinfo=UTC)
BOUNDS = Bounds()
KINDS: tuple[Kind, ...] = ("zip", "tar.gz")


def packed(files: list[tuple[str, bytes]], kind: Kind) -> bytes:
    return b"".join(write(files, kind, NOW))


def tar(*entries: tuple[tarfile.TarInfo, bytes], format: int = tarfile.PAX_FORMAT) -> bytes:
    file = io.BytesIO()
    with tarfile.open(fileobj=file, mode="w", format=format) as archive:
        for info, data in entries:
            info.size = info.size or len(data)
            archive.addfile(info, io.BytesIO(data))
    return file.getvalue()


def named(name: str, **more: object) -> tarfile.TarInfo:
    info = tarfile.TarInfo(name)
    for field, value in more.items():
        setattr(info, field, value)
    return info


def zipped(*entries: tuple[zipfile.ZipInfo | str, bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", method) as archive:
        for info, data in entries:
            archive.writestr(info, data)
    return file.getvalue()


def everything(name: str) -> bool:
    return True


def read(data: bytes, bounds: Bounds = BOUNDS, wanted: Callable[[str], bool] = everything) -> dict[str, object]:
    archive = Archive(io.BytesIO(data), bounds)
    count = archive.check()
    members: dict[str, object] = dict(archive.members(wanted))
    assert len(members) == count
    return members


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_written_is_read_again(kind: Kind) -> None:
    assert read(packed(FILES, kind)) == dict(FILES)
    assert packed(FILES, kind) == packed(FILES, kind)
    assert read(packed([], kind)) == {}
    with_names = read(packed(FILES, kind), wanted=lambda name: name.endswith(".ply"))
    assert with_names == {name: data if name.endswith(".ply") else b"" for name, data in FILES}


def test_an_archive_is_written_a_file_at_a_time() -> None:
    for kind in KINDS:
        pieces = list(write(((f"{n}", random.Random(n).randbytes(2**20)) for n in range(8)), kind, NOW))
        assert len(pieces) == 9
        assert max(map(len, pieces)) < 2**21


def test_what_other_programs_write_is_read() -> None:
    folder = named("sub", type=tarfile.DIRTYPE, mode=0o755)
    entries = [(named("./a"), b"1"), (folder, b""), (named("sub/" + "x" * 90), b"2" * 512), (named("c"), b"3" * 1024)]
    for format in (tarfile.USTAR_FORMAT, tarfile.GNU_FORMAT, tarfile.PAX_FORMAT):
        plain = tar(*entries, format=format)
        for data in (plain, gzip.compress(plain), plain[: plain.rindex(b"3") + 1] + bytes(1024)):
            assert read(data) == {"a": b"1", "sub/" + "x" * 90: b"2" * 512, "c": b"3" * 1024}
    assert read(zipped(("a/", b""), ("a/b", b"1"), method=zipfile.ZIP_STORED)) == {"a/b": b"1"}


OUTSIDE = ("../a", "a/../../b", "/etc/passwd", "..", "C:/a", "c:a", "a\\..\\..\\b", "\\\\host\\a", "./../a")


@pytest.mark.parametrize("name", OUTSIDE)
def test_a_name_that_leads_out_of_it_condemns_the_whole(name: str) -> None:
    for data in (zipped(("good", b"1"), (name, b"2")), tar((named("good"), b"1"), (named(name), b"2"))):
        with pytest.raises(UnreadableArchive, match="leads out"):
            read(data)


@pytest.mark.parametrize("type", [tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.CHRTYPE, tarfile.FIFOTYPE, b"Z"])
def test_links_and_devices_condemn_the_whole(type: bytes) -> None:
    linked = named("link", type=type, linkname="/etc/passwd")
    with pytest.raises(UnreadableArchive, match="link"):
        read(tar((named("good"), b"1"), (linked, b"")))
    info = zipfile.ZipInfo("link")
    info.external_attr = 0o120777 << 16
    with pytest.raises(UnreadableArchive, match="link"):
        read(zipped(("good", b"1"), (info, b"/etc/passwd")))


def test_what_unfolds_out_of_proportion_is_refused_and_never_held() -> None:
    zeros = bytes(2**26)
    sparse = tar((named("a", type=tarfile.GNUTYPE_SPARSE), b"1" * 512))
    bombs = [zipped(("a", zeros)), gzip.compress(tar((named("a"), zeros))), sparse]
    bombs += [gzip.compress(gzip.compress(zeros)), zipped(*[(f"{n}", bytes(2**20)) for n in range(64)])]
    claims = bytearray(zipped(("a", b"1")))
    at = claims.rindex(b"PK\x01\x02")
    claims[at + 24 : at + 28] = struct.pack("<I", 2**32 - 2)
    bombs.append(bytes(claims))
    tracemalloc.start()
    for bomb in bombs:
        with pytest.raises((ArchiveTooLarge, UnreadableArchive)):
            read(bomb)
    assert tracemalloc.get_traced_memory()[1] < 2**25
    tracemalloc.stop()


def test_headers_that_never_end_are_not_read() -> None:
    long = named("a", pax_headers={"comment": "x" * 2**22})
    nested = b"".join(named("n", type=tarfile.XHDTYPE).tobuf() for _ in range(5000))
    longlink = tar((named("././@LongLink", type=tarfile.GNUTYPE_LONGNAME), b"y" * 2**22))
    first = tar((long, b"1"))
    for data in (first, tar((named("good"), b"1"), (long, b"1")), nested + bytes(1024), longlink):
        for sent in (data, gzip.compress(data)):
            with pytest.raises((ArchiveTooLarge, UnreadableArchive)):
                read(sent)


def test_bounds_hold() -> None:
    data = [(f"{number}", b"x" * 10) for number in range(20)]
    for kind in KINDS:
        archive = packed(data, kind)
        assert len(read(archive, Bounds(20, 200, 10))) == 20
        with pytest.raises(ArchiveTooLarge, match="19 entries"):
            read(archive, Bounds(19))
        with pytest.raises(ArchiveTooLarge, match="199"):
            read(archive, Bounds(20, 199))
        members = read(archive, Bounds(20, 10**6, 9))
        assert {type(content) for content in members.values()} == {ArchiveTooLarge}


def test_a_list_of_a_million_tiny_entries_is_refused_at_once() -> None:
    entry = b"PK\x01\x02" + bytes(42)
    listed = entry * 10**6
    end = struct.pack("<4s4H2LH", b"PK\x05\x06", 0, 0, 65535, 65535, len(listed), 0, 0)
    archive = Archive(io.BytesIO(b"PK\x03\x04" + listed + end), Bounds(entries=1000))
    tracemalloc.start()
    with pytest.raises(ArchiveTooLarge, match="entries"):
        archive.check()
    assert tracemalloc.get_traced_memory()[1] < 2**21
    tracemalloc.stop()


@pytest.mark.parametrize("kind", KINDS)
def test_a_truncated_or_altered_archive_is_no_archive(kind: Kind) -> None:
    whole = packed([(name, random.Random(1).randbytes(3000)) for name, _ in FILES], kind)
    for length in (600, len(whole) // 2, len(whole) - 30):
        with pytest.raises(UnreadableArchive):
            read(whole[:length])


def test_a_tar_cut_off_between_its_members_is_truncated() -> None:
    whole = tar((named("a"), b"1" * 512), (named("b"), b"2" * 512))
    for data in (whole[:1024], whole[:2048], whole[:1500], whole[:1024] + b"\xff" * 512 + whole[1024:]):
        for sent in (data, gzip.compress(data)):
            with pytest.raises(UnreadableArchive, match="truncated"):
                read(sent)


def test_a_file_damaged_in_a_zip_spoils_no_other() -> None:
    data = bytearray(zipped(("a", b"first" * 50), ("b", b"second" * 50), method=zipfile.ZIP_STORED))
    data[data.index(b"firstfirst")] ^= 1
    members = read(bytes(data))
    assert isinstance(members["a"], UnreadableArchive)
    assert members["b"] == b"second" * 50
    other = read(zipped(("a", b"1" * 100), method=zipfile.ZIP_BZIP2))
    assert isinstance(other["a"], UnreadableArchive)


@pytest.mark.parametrize(
    "data", [b"", b"PK", b"hello", bytes(512), b"PK\x03\x04", b"PK\x05\x06", b"\x1f\x8b", b"\x1f\x8bx"]
)
def test_what_is_none_is_told(data: bytes) -> None:
    with pytest.raises(UnreadableArchive):
        read(data)


def test_whatever_the_bytes_only_our_errors_are_raised() -> None:
    wholes = [packed(FILES, kind) for kind in KINDS] + [gzip.decompress(packed(FILES, "tar.gz"))]
    for seed in range(600):
        dice = random.Random(seed)
        data = bytearray(dice.choice(wholes))
        for _ in range(dice.randrange(1, 8)):
            data[dice.randrange(len(data))] = dice.randrange(256)
        try:
            read(bytes(data[: dice.randrange(1, len(data) + 1)]))
        except ShapeConceptsError:
            continue
