"""The numbers of a tensor are read as a JSON parser reads them, without its appetite."""

from __future__ import annotations

import json
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.engine.errors import UnreadableCloud
from service.transports.open_inference.json_data import LONGEST, PIECE, cut_out, read_numbers

NUMBERS = st.floats(width=32, allow_nan=False, allow_infinity=False)


def document_of(text: str, after: str = "") -> bytes:
    return f'{{"inputs": [{{"name": "cloud", "data" : {text}{after}}}]}}'.encode()


@settings(max_examples=30, deadline=None)
@given(
    values=st.lists(st.one_of(NUMBERS, st.integers(-99, 99), st.none()), min_size=1, max_size=30),
    times=st.sampled_from([1, 100, 997]),
    separators=st.sampled_from([(",", ":"), (", ", ": "), (" ,\n\t", ": ")]),
    after=st.sampled_from(["", ' , "shape": [1, 3]', ' ,"more":["x"]', "\n"]),
)
def test_lists_of_any_length_are_read_as_a_parser_reads_them(
    values: list[float | None], times: int, separators: tuple[str, str], after: str
) -> None:
    for data in (values * times, [[value] * 3 for value in values * times]):
        whole = document_of(json.dumps(data, separators=separators), after)
        cut = cut_out(whole, len(whole))
        expected = np.array(json.loads(whole)["inputs"][0]["data"], np.float64).astype(np.float32).ravel()
        assert np.array_equal(read_numbers(whole, cut, len(expected)), expected, equal_nan=True)
        assert json.loads(cut.document)["inputs"][0] == json.loads(whole)["inputs"][0] | {"data": cut.text}
        for other in (len(expected) - 1, len(expected) + 1, 10 * len(whole)):
            with pytest.raises(UnreadableCloud):
                read_numbers(whole, cut, other)


@pytest.mark.parametrize(
    "text",
    [
        "[1,2],[3]",
        "[1 2]",
        "[1,,2]",
        "[,1]",
        "[[1,2,3],4]",
        "[[1,2,3]][4]",
        "[[1,2,3]",
        "[1,2,3]]",
        "[01]",
        "[1.]",
        "[nul]",
    ],
)
@pytest.mark.parametrize("before", ["", "1," * PIECE, "[1,2,3]," * PIECE])
def test_what_is_no_list_of_numbers_is_refused(text: str, before: str) -> None:
    whole = document_of(text[0] + before + text[1:])
    for count in (1, 3, before.count("1") * (3 if "[" in before else 1) + 3):
        with pytest.raises(UnreadableCloud):
            read_numbers(whole, cut_out(whole, len(whole)), count)


def test_a_comma_too_many_is_refused_wherever_the_text_was_cut() -> None:
    for count in range(PIECE // 2 - 2, PIECE // 2 + 3):
        whole = document_of("[" + "1," * count + "]")
        with pytest.raises(UnreadableCloud):
            read_numbers(whole, cut_out(whole, len(whole)), count)


def test_no_text_makes_many_times_its_size_of_memory() -> None:
    size = 2**22
    for filler in ("[],", "[[[", "1,", "null,", ",", "9", " ", "[1,2,3],"):
        whole = document_of("[" + filler * (size // len(filler)) + "]")
        tracemalloc.start()
        with pytest.raises(UnreadableCloud):
            read_numbers(whole, cut_out(whole, len(whole)), 3 * (size // 8) + 10)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert peak < 4 * size


def test_only_the_list_may_be_long() -> None:
    for whole in (b"[" * LONGEST * 2, b'{"id": "' + b"x" * LONGEST + b'", "data": [1]}', b'"data"' * LONGEST):
        with pytest.raises(UnreadableCloud, match="beside its list"):
            cut_out(whole, len(whole))
    whole = b'{"id": "\\"data\\": [1, 2]", "data": [3]}'
    cut = cut_out(whole, len(whole))
    assert json.loads(cut.document) == {"id": '"data": [1, 2]', "data": cut.text}
