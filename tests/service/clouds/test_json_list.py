"""A list of clouds is cut where a parser would cut it."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.clouds.json_list import split
from service.engine.errors import UnreadableCloud

split(b"[1]", 1)  # compiled: the first call takes its time

VALUES = st.recursive(
    st.none() | st.floats(allow_nan=False) | st.text(alphabet='[]{},"\\ a'),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(alphabet='[]{},"\\a'), inner, max_size=3),
    max_leaves=12,
)


@given(st.lists(VALUES, min_size=1, max_size=8), st.sampled_from([None, 1]))
def test_the_parts_are_the_elements(elements: list[Any], indent: int | None) -> None:
    text = json.dumps(elements, indent=indent).encode()
    assert [json.loads(part) for part in split(text, 100)] == elements


@given(st.lists(VALUES, min_size=1, max_size=8), st.integers(1, 8))
def test_no_more_parts_are_cut_out_than_asked_for(elements: list[Any], most: int) -> None:
    assert len(split(json.dumps(elements).encode(), most)) == min(most, len(elements))


@pytest.mark.parametrize("text", ["", "{}", "[", "[]", "[ ]", "[1", "[1]]", "[1] 2", '["', "nul", "]", '["\\"]'])
def test_what_is_no_list_is_refused(text: str) -> None:
    with pytest.raises(UnreadableCloud, match="JSON"):
        split(text.encode(), 10)
