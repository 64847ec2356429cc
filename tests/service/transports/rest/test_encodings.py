"""Compressed bodies are read as what they hold, and bombs are refused while they are small."""

from __future__ import annotations

import asyncio
import gzip
import tracemalloc
import zlib
from collections.abc import AsyncIterator, Callable

import httpx
import numpy as np
import pytest
from starlette.exceptions import HTTPException
from starlette.requests import Request

from service.clouds import write_ply
from service.engine.cloud import PointCloud
from service.settings import Settings
from service.transports.rest.encodings import RATIO, Decoding
from tests.service.transports.rest.test_responses import answer_of


def raw_deflate(data: bytes) -> bytes:
    packer = zlib.compressobj(wbits=-zlib.MAX_WBITS)
    return packer.compress(data) + packer.flush()


PACKED = {
    "gzip": ("gzip", gzip.compress),
    "GZip": ("GZip", gzip.compress),
    "x-gzip": ("x-gzip", gzip.compress),
    "two gzip members": ("gzip", lambda data: gzip.compress(data[:50]) + gzip.compress(data[50:])),
    "deflate": ("deflate", zlib.compress),
    "deflate without a header": ("deflate", raw_deflate),
    "identity": ("identity", bytes),
}


@pytest.mark.parametrize(("coding", "pack"), PACKED.values(), ids=PACKED)
def test_a_compressed_cloud_has_the_answer_of_the_cloud(
    client: httpx.Client, clouds: list[PointCloud], coding: str, pack: Callable[[bytes], bytes]
) -> None:
    ply = write_ply(clouds[0])
    plain = answer_of(client.post("/v1/responses", content=ply))
    assert answer_of(client.post("/v1/responses", content=pack(ply), headers={"content-encoding": coding})) == plain


def test_a_form_may_be_compressed_as_well(client: httpx.Client, clouds: list[PointCloud]) -> None:
    form = httpx.Request("POST", "http://x", files={"cloud": write_ply(clouds[0])})
    headers = {"content-type": form.headers["content-type"], "content-encoding": "gzip"}
    answer_of(client.post("/v1/responses", content=gzip.compress(form.read()), headers=headers))


@pytest.mark.parametrize(
    ("coding", "content", "status", "kind"),
    [
        ("br", b"x", 415, "unsupported-encoding"),
        ("gzip, gzip", gzip.compress(gzip.compress(b"1 2 3\n", mtime=0), mtime=0), 415, "unsupported-encoding"),
        ("gzip", b"1 2 3\n" * 50, 400, "unreadable-body"),
        ("gzip", gzip.compress(b"1 2 3\n" * 50, mtime=0)[:-9], 400, "unreadable-body"),
        ("gzip", gzip.compress(b"1 2 3\n" * 50, mtime=0) + b"more", 400, "unreadable-body"),
        ("deflate", b"\xff" * 50, 400, "unreadable-body"),
        ("gzip", b"", 422, "empty-cloud"),
        ("gzip", gzip.compress(bytes(2**27), mtime=0), 413, "content-too-large"),
        ("gzip", gzip.compress(np.random.default_rng(1).bytes(2**19) * 4, mtime=0), 413, "content-too-large"),
    ],
)
def test_what_cannot_be_unpacked_is_refused(
    client: httpx.Client, coding: str, content: bytes, status: int, kind: str
) -> None:
    response = client.post("/v1/responses", content=content, headers={"content-encoding": coding})
    assert (response.status_code, response.json()["type"]) == (status, f"urn:shape-concepts:error:{kind}")
    assert status != 415 or response.headers["accept-encoding"] == "gzip, deflate"


class TestWithLargeBodies:
    @pytest.fixture
    def settings(self, settings: Settings) -> Settings:
        return settings.model_copy(update={"max_body": 2**28, "max_bodies": 2**28})

    def test_what_unfolds_as_no_cloud_does_is_refused_by_its_proportion(self, client: httpx.Client) -> None:
        refused = client.post(
            "/v1/responses", content=gzip.compress(bytes(2**27)), headers={"content-encoding": "gzip"}
        )
        assert refused.status_code == 413
        assert f"{RATIO} times" in refused.json()["detail"]

    def test_an_organised_cloud_of_which_little_returned_is_none_of_these(self, client: httpx.Client) -> None:
        ply_like = np.full((480 * 640, 3), np.nan, np.float32)
        ply_like[1000:1050] = np.random.default_rng(1).normal(size=(50, 3))
        head = b"ply\nformat binary_little_endian 1.0\nelement vertex 307200\n"
        head += b"".join(b"property float %c\n" % axis for axis in b"xyz") + b"end_header\n"
        content = gzip.compress(head + ply_like.tobytes())
        answer = client.post("/v1/responses", content=content, headers={"content-encoding": "gzip"})
        assert answer.json()["type"].endswith("too-few-points")


def test_a_bomb_never_lies_in_memory_unfolded() -> None:
    bomb = gzip.compress(bytes(2**26))

    async def chunks() -> AsyncIterator[dict]:
        for start in range(0, len(bomb), 2**12):
            yield {"type": "http.request", "body": bomb[start : start + 2**12], "more_body": True}

    async def read(scope, receive, send) -> None:
        async for _ in Request(scope, receive).stream():
            pass

    async def run() -> None:
        arriving = chunks()
        scope = {"type": "http", "headers": [(b"content-encoding", b"gzip")]}
        with pytest.raises(HTTPException, match="413"):
            await Decoding(read)(scope, lambda: anext(arriving), None)

    tracemalloc.start()
    asyncio.run(run())
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2**22


def test_large_answers_are_compressed_for_those_who_accept_it(client: httpx.Client, clouds: list[PointCloud]) -> None:
    for path, large in (("/v1/models/tiny/versions/1", False), ("/openapi.json", True)):
        packed = client.get(path, headers={"accept-encoding": "gzip"})
        plain = client.get(path, headers={"accept-encoding": "identity"})
        assert ("content-encoding" in packed.headers) == large
        assert "content-encoding" not in plain.headers
        assert packed.json() == plain.json()
