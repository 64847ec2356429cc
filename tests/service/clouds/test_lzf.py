"""LZF, against a plain decoder and known streams."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.clouds.lzf import decompress
from service.engine.errors import UnreadableCloud

literals = st.binary(min_size=1, max_size=32).map(lambda run: ("literal", run))
references = st.tuples(st.integers(1, 8192), st.integers(3, 264)).map(lambda pair: ("reference", pair))


def pack(tokens: list) -> tuple[bytes, bytes]:
    """The stream of some tokens, and what it stands for; references are kept within what came before."""
    packed, plain = bytearray(), bytearray()
    for kind, token in tokens:
        if kind == "literal":
            packed += bytes([len(token) - 1]) + token
            plain += token
        elif plain:
            back, length = min(token[0], len(plain)), token[1]
            high, low = divmod(back - 1, 256)
            code = length - 2
            packed += bytes([min(code, 7) << 5 | high] + ([code - 7] if code >= 7 else []) + [low])
            for _ in range(length):
                plain.append(plain[-back])
    return bytes(packed), bytes(plain)


@settings(deadline=None, derandomize=True)
@given(st.lists(literals | references, min_size=1, max_size=40))
def test_tokens_unfold_to_what_they_stand_for(tokens: list):
    packed, plain = pack(tokens)
    assert decompress(packed, len(plain), len(plain), "test").tobytes() == plain
    part = len(plain) // 2
    assert decompress(packed, part, len(plain), "test").tobytes() == plain[:part]


@settings(deadline=None, derandomize=True)
@given(st.lists(literals | references, min_size=1, max_size=40), st.data())
def test_a_stream_cut_anywhere_is_refused(tokens: list, data: st.DataObject):
    packed, plain = pack(tokens)
    if plain:
        cut = data.draw(st.integers(0, len(packed) - 1))
        with pytest.raises(UnreadableCloud):
            decompress(packed[:cut], len(plain), len(plain), "test")


@settings(deadline=None, derandomize=True)
@given(st.binary(max_size=200), st.integers(0, 4000))
def test_random_bytes_unfold_or_are_refused(packed: bytes, size: int):
    with contextlib.suppress(UnreadableCloud):
        assert decompress(packed, size, size, "test").size == size


def test_a_run_of_one_byte_unfolds_by_overlapping_itself():
    packed, plain = pack([("literal", b"a"), ("reference", (1, 264))])
    assert plain == b"a" * 265
    assert len(packed) == 5
    assert np.all(decompress(packed, 265, 265, "test") == ord("a"))
