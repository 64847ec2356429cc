"""NPZ, NumPy's archive of arrays: a zip, whose own sizes are not believed; what is read of it is bounded."""

from __future__ import annotations

import io
import zipfile

from service.clouds.claims import check_bytes, check_count, check_unpacked, quote
from service.clouds.frame import RawCloud
from service.clouds.npy import HEADER_LIMIT, Layout, flaw_of, read_layout, to_xyz
from service.engine.errors import ShapeConceptsError, UnreadableCloud

NAMES = ("points", "xyz", "cloud", "positions")  # the first of these that is there is the cloud
MOST_MEMBERS = 1000
_DIRECTORY_ENTRY = b"PK\x01\x02"


def read(data: bytes, max_points: int) -> RawCloud:
    """Reads the array named points, xyz, cloud or positions, or the only one that is a cloud.

    Raises:
        EmptyCloud, TooManyPoints: by the array's shape.
        UnreadableCloud: a damaged archive, or no such array, or several.
    """
    if data.count(_DIRECTORY_ENTRY) > MOST_MEMBERS:
        raise UnreadableCloud(f"NPZ: it has more than {MOST_MEMBERS} members; send the cloud's array alone")
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            return _read_archive(archive, max_points)
    except ShapeConceptsError:
        raise
    except Exception as error:  # zipfile lets errors of zlib, struct, codecs and its own through
        raise UnreadableCloud(
            f"NPZ: the archive is truncated or damaged ({quote(str(error), 120)}); save it again with numpy.savez"
        ) from error


def _read_archive(archive: zipfile.ZipFile, max_points: int) -> RawCloud:
    members = {info.filename.removesuffix(".npy"): info for info in archive.infolist() if not info.is_dir()}
    name = next((name for name in NAMES if name in members), None) or _only_cloud(archive, members)
    layout = _layout(archive, members[name])
    where = f"the array {quote(name)} of this NPZ"
    if flaw := flaw_of(layout):
        raise UnreadableCloud(f"NPZ, array {quote(name)}: {flaw}")
    check_count(layout.points, max_points, where)
    check_unpacked(layout.size, max_points, where)
    with _open(archive, members[name]) as member:
        member.read(layout.body)
        octets = member.read(layout.size)
        member.read(1)  # past the end, where zipfile compares the checksum
    check_bytes(layout.size, len(octets), where)
    return RawCloud(to_xyz(octets, layout), width=layout.width)


def _only_cloud(archive: zipfile.ZipFile, members: dict[str, zipfile.ZipInfo]) -> str:
    """The one array that can be a cloud; of several, the one of floats: an image may lie beside its cloud."""
    layouts = {}
    for name, info in members.items():
        layout = _layout(archive, info)
        if not flaw_of(layout):
            layouts[name] = layout
    floats = [name for name, layout in layouts.items() if layout.dtype.names or layout.dtype.kind == "f"]
    for candidates in (list(layouts), floats):
        if len(candidates) == 1:
            return candidates[0]
    raise UnreadableCloud(
        f"NPZ: of its arrays {quote(list(members), 200)}, {len(layouts)} can be a cloud; "
        f"name the one that is {', '.join(NAMES[:-1])} or {NAMES[-1]}"
    )


def _layout(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> Layout:
    with _open(archive, info) as member:
        return read_layout(member.read(HEADER_LIMIT), f"the member {quote(info.filename)} of this NPZ")


def _open(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> zipfile.ZipExtFile:
    """Opens a member; only what NumPy writes, for other methods may claim memory by their headers."""
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise UnreadableCloud(
            f"NPZ: its member {quote(info.filename)} is compressed by another method than NumPy's; "
            "save it again with numpy.savez_compressed"
        )
    return archive.open(info)  # type: ignore[return-value]  # typeshed says IO[bytes]
